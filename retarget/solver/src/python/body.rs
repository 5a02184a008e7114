//! Kinematics for Python: `Body` for one posture or many, `Probe` and `Footing` for one posture tick by tick.

use super::arrays::{bad, entries, index, matrix, rows, table, vector, Integers, Matrix, Numbers, Table, Vector};
use crate::body::{Body, Joint, JointKind, Link};
use crate::kinematics::Pose;
use crate::math::{dot, sub, Vec3};
use numpy::{PyArray1, PyArray3, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::sync::Arc;

type Stack<'py> = Bound<'py, PyArray3<f64>>;

/// A tree of links and joints; see `retarget/_solver.pyi`.
#[pyclass(name = "Body", module = "retarget._solver", frozen)]
pub struct PyBody {
    pub body: Arc<Body>,
}

impl PyBody {
    fn pose(&self, q: &Numbers<'_>) -> PyResult<Pose> {
        let mut pose = self.body.new_pose();
        self.body.forward(entries(q, self.body.nq, "q")?, &mut pose);
        self.body.mass_properties(&mut pose);
        Ok(pose)
    }

    /// Results of `read` in every posture of q (T, nq), one after the other.
    fn read_all(&self, q: &Table<'_>, mut read: impl FnMut(&Pose, &mut Vec<f64>)) -> PyResult<Vec<f64>> {
        let (mut pose, mut found) = (self.body.new_pose(), vec![]);
        for row in table(q, q.shape()[0], self.body.nq, "q")?.chunks_exact(self.body.nq) {
            self.body.forward(row, &mut pose);
            self.body.mass_properties(&mut pose);
            read(&pose, &mut found);
        }
        Ok(found)
    }

    /// A Jacobian (ROWS, nv) from its columns; those of other coordinates are 0.
    fn jacobian<'py, const ROWS: usize>(
        &self,
        py: Python<'py>,
        dofs: impl IntoIterator<Item = usize>,
        column: impl Fn(usize) -> [f64; ROWS],
    ) -> PyResult<Matrix<'py>> {
        let mut values = vec![0.0; ROWS * self.body.nv];
        for dof in dofs {
            for (k, value) in column(dof).into_iter().enumerate() {
                values[k * self.body.nv + dof] = value;
            }
        }
        PyArray1::from_vec(py, values).reshape([ROWS, self.body.nv])
    }
}

fn check_links(body: &Body, links: &[usize]) -> PyResult<()> {
    match links.iter().find(|link| **link >= body.links.len()) {
        Some(link) => Err(bad(format!("link {link} does not exist; the body has {}", body.links.len()))),
        None => Ok(()),
    }
}

/// Points `local` of `links`.
pub fn points(body: &Body, links: &[usize], local: &Table<'_>, name: &str) -> PyResult<Vec<(usize, Vec3)>> {
    check_links(body, links)?;
    Ok(links.iter().copied().zip(rows::<3>(local, links.len(), name)?.iter().copied()).collect())
}

#[pymethods]
impl PyBody {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        parent: Integers<'_>,
        body_pos: Table<'_>,
        body_quat: Table<'_>,
        mass: Numbers<'_>,
        com: Table<'_>,
        joint_body: Integers<'_>,
        joint_type: Integers<'_>,
        joint_axis: Table<'_>,
        joint_pos: Table<'_>,
        qpos0: Numbers<'_>,
    ) -> PyResult<Self> {
        let (parent, joint_body) = (parent.as_slice()?, joint_body.as_slice()?);
        let (nb, nj) = (parent.len(), joint_body.len());
        let (pos, quat) = (rows::<3>(&body_pos, nb, "body_pos")?, rows::<4>(&body_quat, nb, "body_quat")?);
        let (com, mass) = (rows::<3>(&com, nb, "com")?, vector(&mass, nb, "mass")?);
        let (axis, anchor) = (rows::<3>(&joint_axis, nj, "joint_axis")?, rows::<3>(&joint_pos, nj, "joint_pos")?);
        let codes = entries(&joint_type, nj, "joint_type")?;
        let link = |b: usize| Link {
            parent: index(parent[b]),
            pos: pos[b],
            quat: quat[b],
            mass: mass[b],
            com: com[b],
            joints: (0, 0),
            chain: vec![],
        };
        let joint = |j: usize| {
            let kinds = [JointKind::Free, JointKind::Ball, JointKind::Slide, JointKind::Hinge];
            let unknown = || bad(format!("joint_type[{j}] is {}; 0 free, 1 ball, 2 slide, 3 hinge", codes[j]));
            let kind = *kinds.get(index(codes[j])).ok_or_else(unknown)?;
            let (body, axis, pos) = (index(joint_body[j]), axis[j], anchor[j]);
            Ok(Joint { body, kind, axis, pos, q_address: 0, v_address: 0, q_rest: 0.0 })
        };
        let joints = (0..nj).map(joint).collect::<PyResult<_>>()?;
        let mut body = Body::new((0..nb).map(link).collect(), joints).map_err(bad)?;
        let rest = vector(&qpos0, body.nq, "qpos0")?;
        for joint in body.joints.iter_mut().filter(|joint| joint.kind.size() == (1, 1)) {
            joint.q_rest = rest[joint.q_address];
        }
        Ok(Self { body: Arc::new(body) })
    }

    #[getter]
    fn nq(&self) -> usize {
        self.body.nq
    }

    #[getter]
    fn nv(&self) -> usize {
        self.body.nv
    }

    #[getter]
    fn total_mass(&self) -> f64 {
        self.body.total_mass
    }

    fn rest<'py>(&self, py: Python<'py>) -> Vector<'py> {
        PyArray1::from_vec(py, self.body.rest())
    }

    fn forward<'py>(&self, py: Python<'py>, q: Numbers<'py>) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
        let pose = self.pose(&q)?;
        Ok((matrix(py, &pose.position)?, matrix(py, &pose.quat)?))
    }

    fn points<'py>(
        &self,
        py: Python<'py>,
        q: Table<'py>,
        links: Vec<usize>,
        local: Table<'py>,
    ) -> PyResult<Stack<'py>> {
        let points = points(&self.body, &links, &local, "local")?;
        let place = |pose: &Pose, (link, local)| self.body.point(pose, link, local);
        let found = self.read_all(&q, |pose, out| out.extend(points.iter().flat_map(|point| place(pose, *point))))?;
        PyArray1::from_vec(py, found).reshape([q.shape()[0], links.len(), 3])
    }

    fn orientations<'py>(&self, py: Python<'py>, q: Table<'py>, links: Vec<usize>) -> PyResult<Stack<'py>> {
        check_links(&self.body, &links)?;
        let found = self.read_all(&q, |pose, out| out.extend(links.iter().flat_map(|link| pose.quat[*link])))?;
        PyArray1::from_vec(py, found).reshape([q.shape()[0], links.len(), 4])
    }

    fn centre_of_mass<'py>(&self, py: Python<'py>, q: Table<'py>) -> PyResult<Matrix<'py>> {
        let found = self.read_all(&q, |pose, out| out.extend(pose.com))?;
        PyArray1::from_vec(py, found).reshape([q.shape()[0], 3])
    }

    fn frame_jacobian<'py>(&self, py: Python<'py>, q: Numbers<'py>, link: usize, local: Vec3) -> PyResult<Matrix<'py>> {
        let (body, pose) = (&self.body, self.pose(&q)?);
        check_links(body, &[link])?;
        let point = body.point(&pose, link, local);
        self.jacobian(py, body.links[link].chain.iter().copied(), |dof| {
            let ([x, y, z], [u, v, w]) = (body.point_column(&pose, dof, point), body.angular_column(&pose, dof));
            [x, y, z, u, v, w]
        })
    }

    fn centre_of_mass_jacobian<'py>(&self, py: Python<'py>, q: Numbers<'py>) -> PyResult<Matrix<'py>> {
        let pose = self.pose(&q)?;
        self.jacobian(py, 0..self.body.nv, |dof| self.body.com_column(&pose, dof))
    }

    fn integrate<'py>(&self, py: Python<'py>, q: Numbers<'py>, dq: Numbers<'py>) -> PyResult<Vector<'py>> {
        let mut out = entries(&q, self.body.nq, "q")?.to_vec();
        self.body.integrate(&mut out, entries(&dq, self.body.nv, "dq")?);
        Ok(PyArray1::from_vec(py, out))
    }

    fn difference<'py>(&self, py: Python<'py>, q_from: Numbers<'py>, q_to: Numbers<'py>) -> PyResult<Vector<'py>> {
        let mut dq = vec![0.0; self.body.nv];
        let (from, to) = (entries(&q_from, self.body.nq, "q_from")?, entries(&q_to, self.body.nq, "q_to")?);
        self.body.difference(from, to, &mut dq);
        Ok(PyArray1::from_vec(py, dq))
    }
}

/// Points fixed to links of one body, and a posture of it.
struct Reader {
    body: Arc<Body>,
    points: Vec<(usize, Vec3)>,
    pose: Pose,
}

impl Reader {
    fn new(body: &PyBody, links: &[usize], local: &Table<'_>) -> PyResult<Self> {
        let body = body.body.clone();
        Ok(Self { points: points(&body, links, local, "local")?, pose: body.new_pose(), body })
    }

    fn go_to(&mut self, q: &[f64]) {
        self.body.forward(q, &mut self.pose);
        self.body.mass_properties(&mut self.pose);
    }

    fn places(&self) -> impl Iterator<Item = Vec3> + '_ {
        self.points.iter().map(|(link, local)| self.body.point(&self.pose, *link, *local))
    }
}

/// See `retarget/_solver.pyi`.
#[pyclass(name = "Probe", module = "retarget._solver")]
pub struct PyProbe {
    reader: Reader,
    oriented: Vec<usize>,
}

#[pymethods]
impl PyProbe {
    #[new]
    fn new(body: &PyBody, links: Vec<usize>, local: Table<'_>, oriented: Vec<usize>) -> PyResult<Self> {
        check_links(&body.body, &oriented)?;
        Ok(Self { reader: Reader::new(body, &links, &local)?, oriented })
    }

    fn read<'py>(&mut self, py: Python<'py>, q: Numbers<'py>) -> PyResult<(Matrix<'py>, Matrix<'py>, Vector<'py>)> {
        self.reader.go_to(entries(&q, self.reader.body.nq, "q")?);
        let pose = &self.reader.pose;
        let places: Vec<_> = self.reader.places().collect();
        let turns: Vec<_> = self.oriented.iter().map(|link| pose.quat[*link]).collect();
        Ok((matrix(py, &places)?, matrix(py, &turns)?, PyArray1::from_slice(py, &pose.com)))
    }
}

/// See `retarget/_solver.pyi`.
#[pyclass(name = "Footing", module = "retarget._solver")]
pub struct PyFooting {
    reader: Reader,
    planted: Vec<Vec3>,
    edges: Vec<Vec3>,
}

#[pymethods]
impl PyFooting {
    #[new]
    fn new(body: &PyBody, links: Vec<usize>, local: Table<'_>, planted: Table<'_>, edges: Table<'_>) -> PyResult<Self> {
        let planted = rows(&planted, links.len(), "planted")?.to_vec();
        let edges = rows(&edges, edges.shape()[0], "edges")?.to_vec();
        Ok(Self { reader: Reader::new(body, &links, &local)?, planted, edges })
    }

    fn losses(&mut self, path: Table<'_>) -> PyResult<(f64, f64)> {
        let nq = self.reader.body.nq;
        let (mut off, mut inside) = (0.0_f64, f64::INFINITY);
        for q in table(&path, path.shape()[0], nq, "path")?.chunks_exact(nq) {
            self.reader.go_to(q);
            for (place, planted) in self.reader.places().zip(&self.planted) {
                let gone = sub(place, *planted);
                off = largest(off, dot(gone, gone));
            }
            let com = self.reader.pose.com;
            for [nx, ny, most] in &self.edges {
                inside = -largest(-inside, nx * com[0] + ny * com[1] - most);
            }
        }
        Ok((off.sqrt(), inside))
    }
}

/// The larger of two numbers; NaN if one of them is NaN.
fn largest(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b {
        a
    } else {
        b
    }
}

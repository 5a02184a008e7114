//! `Body` for Python: kinematics of one posture or of many.

use super::arrays::{bad, finite, table, triple};
use crate::body::{Body, Joint, JointKind, Link};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::sync::Arc;

/// A tree of links and joints; see `retarget/_solver.pyi`.
#[pyclass(name = "Body", module = "retarget._solver", frozen)]
pub struct PyBody {
    pub body: Arc<Body>,
}

impl PyBody {
    fn posture<'a>(&self, q: &'a PyReadonlyArray1<'_, f64>) -> PyResult<&'a [f64]> {
        let q = q.as_slice()?;
        if q.len() != self.body.nq {
            return Err(bad(format!("q has {} entries, the body {}", q.len(), self.body.nq)));
        }
        Ok(q)
    }

    fn link(&self, link: usize) -> PyResult<usize> {
        if link < self.body.links.len() {
            Ok(link)
        } else {
            Err(bad(format!("link {link} does not exist; the body has {}", self.body.links.len())))
        }
    }

    fn postures<'a>(&self, q: &'a PyReadonlyArray2<'_, f64>) -> PyResult<&'a [f64]> {
        if q.shape()[1] != self.body.nq {
            return Err(bad(format!("q has {} columns, the body {}", q.shape()[1], self.body.nq)));
        }
        Ok(q.as_slice()?)
    }
}

#[pymethods]
impl PyBody {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        parent: PyReadonlyArray1<'_, i64>,
        body_pos: PyReadonlyArray2<'_, f64>,
        body_quat: PyReadonlyArray2<'_, f64>,
        mass: PyReadonlyArray1<'_, f64>,
        com: PyReadonlyArray2<'_, f64>,
        joint_body: PyReadonlyArray1<'_, i64>,
        joint_type: PyReadonlyArray1<'_, i64>,
        joint_axis: PyReadonlyArray2<'_, f64>,
        joint_pos: PyReadonlyArray2<'_, f64>,
        qpos0: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let parent = parent.as_slice()?;
        let (nb, nj) = (parent.len(), joint_body.len());
        let (pos, quat) = (table(&body_pos, nb, 3, "body_pos")?, table(&body_quat, nb, 4, "body_quat")?);
        let (com, mass) = (table(&com, nb, 3, "com")?, mass.as_slice()?);
        let (axis, anchor) = (table(&joint_axis, nj, 3, "joint_axis")?, table(&joint_pos, nj, 3, "joint_pos")?);
        if mass.len() != nb || joint_type.len() != nj {
            return Err(bad("mass needs one entry per link, joint_type one per joint".into()));
        }
        finite(mass, "mass")?;
        let links = (0..nb)
            .map(|b| Link {
                parent: usize::try_from(parent[b]).unwrap_or(usize::MAX),
                pos: triple(&pos[3 * b..]),
                quat: [quat[4 * b], quat[4 * b + 1], quat[4 * b + 2], quat[4 * b + 3]],
                mass: mass[b],
                com: triple(&com[3 * b..]),
                joints: (0, 0),
                chain: vec![],
            })
            .collect();
        let mut joints = vec![];
        for j in 0..nj {
            let code = joint_type.as_slice()?[j];
            joints.push(Joint {
                body: usize::try_from(joint_body.as_slice()?[j]).unwrap_or(usize::MAX),
                kind: JointKind::from_code(code)
                    .ok_or_else(|| bad(format!("joint_type[{j}] is {code}; 0 free, 1 ball, 2 slide, 3 hinge")))?,
                axis: triple(&axis[3 * j..]),
                pos: triple(&anchor[3 * j..]),
                q_address: 0,
                v_address: 0,
                q_rest: 0.0,
            });
        }
        let mut body = Body::new(links, joints).map_err(bad)?;
        let rest = qpos0.as_slice()?;
        if rest.len() != body.nq {
            return Err(bad(format!("qpos0 has {} entries, expected {}", rest.len(), body.nq)));
        }
        finite(rest, "qpos0")?;
        for joint in &mut body.joints {
            if matches!(joint.kind, JointKind::Hinge | JointKind::Slide) {
                joint.q_rest = rest[joint.q_address];
            }
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
    fn nbody(&self) -> usize {
        self.body.links.len()
    }

    #[getter]
    fn total_mass(&self) -> f64 {
        self.body.total_mass
    }

    fn rest<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.body.rest())
    }

    #[allow(clippy::type_complexity)]
    fn forward<'py>(
        &self,
        py: Python<'py>,
        q: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>)> {
        let q = self.posture(&q)?;
        let mut pose = self.body.new_pose();
        self.body.forward(q, &mut pose);
        let positions: Vec<Vec<f64>> = pose.position.iter().map(|p| p.to_vec()).collect();
        let quats: Vec<Vec<f64>> = pose.quat.iter().map(|p| p.to_vec()).collect();
        Ok((PyArray2::from_vec2(py, &positions)?, PyArray2::from_vec2(py, &quats)?))
    }

    /// World positions (T, k, 3) of points fixed to links.
    fn points<'py>(
        &self,
        py: Python<'py>,
        q: PyReadonlyArray2<'py, f64>,
        links: Vec<usize>,
        local: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (t, k) = (q.shape()[0], links.len());
        let q = self.postures(&q)?;
        let local = table(&local, k, 3, "local")?;
        for &link in &links {
            self.link(link)?;
        }
        let values = py.detach(|| {
            let mut pose = self.body.new_pose();
            let mut out = Vec::with_capacity(t * k * 3);
            for row in q.chunks_exact(self.body.nq) {
                self.body.forward(row, &mut pose);
                for (i, &link) in links.iter().enumerate() {
                    out.extend(self.body.point(&pose, link, triple(&local[3 * i..])));
                }
            }
            out
        });
        PyArray1::from_vec(py, values).reshape([t, k, 3])
    }

    /// World orientations (T, k, 4) wxyz of links.
    fn orientations<'py>(
        &self,
        py: Python<'py>,
        q: PyReadonlyArray2<'py, f64>,
        links: Vec<usize>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (t, k) = (q.shape()[0], links.len());
        let q = self.postures(&q)?;
        for &link in &links {
            self.link(link)?;
        }
        let mut pose = self.body.new_pose();
        let mut out = Vec::with_capacity(t * k * 4);
        for row in q.chunks_exact(self.body.nq) {
            self.body.forward(row, &mut pose);
            for &link in &links {
                out.extend(pose.quat[link]);
            }
        }
        PyArray1::from_vec(py, out).reshape([t, k, 4])
    }

    fn centre_of_mass<'py>(
        &self,
        py: Python<'py>,
        q: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let t = q.shape()[0];
        let q = self.postures(&q)?;
        let mut pose = self.body.new_pose();
        let mut out = Vec::with_capacity(t * 3);
        for row in q.chunks_exact(self.body.nq) {
            self.body.forward(row, &mut pose);
            self.body.mass_properties(&mut pose);
            out.extend(pose.com);
        }
        PyArray1::from_vec(py, out).reshape([t, 3])
    }

    /// (6, nv): linear rows, then angular rows, world frame, of a point fixed to a link.
    fn frame_jacobian<'py>(
        &self,
        py: Python<'py>,
        q: PyReadonlyArray1<'py, f64>,
        link: usize,
        local: [f64; 3],
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let q = self.posture(&q)?;
        let link = self.link(link)?;
        let mut pose = self.body.new_pose();
        self.body.forward(q, &mut pose);
        let point = self.body.point(&pose, link, local);
        let jacobian = PyArray2::zeros(py, [6, self.body.nv], false);
        let mut view = unsafe { jacobian.as_array_mut() };
        for &dof in &self.body.links[link].chain {
            let (linear, angular) = (self.body.point_column(&pose, dof, point), self.body.angular_column(&pose, dof));
            for k in 0..3 {
                view[[k, dof]] = linear[k];
                view[[k + 3, dof]] = angular[k];
            }
        }
        Ok(jacobian)
    }

    /// (3, nv) of the centre of mass.
    fn centre_of_mass_jacobian<'py>(
        &self,
        py: Python<'py>,
        q: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let q = self.posture(&q)?;
        let mut pose = self.body.new_pose();
        self.body.forward(q, &mut pose);
        self.body.mass_properties(&mut pose);
        let jacobian = PyArray2::zeros(py, [3, self.body.nv], false);
        let mut view = unsafe { jacobian.as_array_mut() };
        for dof in 0..self.body.nv {
            let c = self.body.com_column(&pose, dof);
            for k in 0..3 {
                view[[k, dof]] = c[k];
            }
        }
        Ok(jacobian)
    }

    /// q (+) dq
    fn integrate<'py>(
        &self,
        py: Python<'py>,
        q: PyReadonlyArray1<'py, f64>,
        dq: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let mut out = self.posture(&q)?.to_vec();
        let dq = dq.as_slice()?;
        if dq.len() != self.body.nv {
            return Err(bad(format!("dq has {} entries, the body {}", dq.len(), self.body.nv)));
        }
        self.body.integrate(&mut out, dq);
        Ok(PyArray1::from_vec(py, out))
    }

    /// dq with q_from (+) dq = q_to
    fn difference<'py>(
        &self,
        py: Python<'py>,
        q_from: PyReadonlyArray1<'py, f64>,
        q_to: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let mut dq = vec![0.0; self.body.nv];
        self.body.difference(self.posture(&q_from)?, self.posture(&q_to)?, &mut dq);
        Ok(PyArray1::from_vec(py, dq))
    }
}

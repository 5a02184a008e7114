//! What is read of a posture tick by tick: places, orientations, the centre of mass, in one go.

use super::arrays::{bad, table, triple};
use super::body::PyBody;
use crate::body::Body;
use crate::kinematics::Pose;
use crate::math::{dot, sub, Vec3};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::sync::Arc;

type Table<'py> = Bound<'py, PyArray2<f64>>;

/// Points fixed to links of one body, and a posture of it.
struct Reader {
    body: Arc<Body>,
    points: Vec<(usize, Vec3)>,
    pose: Pose,
}

impl Reader {
    fn new(body: &PyBody, links: &[usize], local: &PyReadonlyArray2<'_, f64>) -> PyResult<Self> {
        let body = body.body.clone();
        let local = table(local, links.len(), 3, "local")?;
        check_links(&body, links)?;
        let points = links.iter().zip(local.chunks_exact(3)).map(|(link, p)| (*link, triple(p))).collect();
        Ok(Self { pose: body.new_pose(), points, body })
    }

    fn go_to(&mut self, q: &[f64]) {
        self.body.forward(q, &mut self.pose);
        self.body.mass_properties(&mut self.pose);
    }

    fn point(&self, i: usize) -> Vec3 {
        let (link, local) = self.points[i];
        self.body.point(&self.pose, link, local)
    }
}

fn check_links(body: &Body, links: &[usize]) -> PyResult<()> {
    match links.iter().find(|link| **link >= body.links.len()) {
        Some(link) => Err(bad(format!("link {link} does not exist; the body has {}", body.links.len()))),
        None => Ok(()),
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
    fn new(body: &PyBody, links: Vec<usize>, local: PyReadonlyArray2<'_, f64>, oriented: Vec<usize>) -> PyResult<Self> {
        check_links(&body.body, &oriented)?;
        Ok(Self { reader: Reader::new(body, &links, &local)?, oriented })
    }

    fn read<'py>(
        &mut self,
        py: Python<'py>,
        q: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(Table<'py>, Table<'py>, Bound<'py, PyArray1<f64>>)> {
        let q = q.as_slice()?;
        if q.len() != self.reader.body.nq {
            return Err(bad(format!("q has {} entries, the body {}", q.len(), self.reader.body.nq)));
        }
        self.reader.go_to(q);
        let (reader, pose) = (&self.reader, &self.reader.pose);
        let points: Vec<f64> = (0..reader.points.len()).flat_map(|i| reader.point(i)).collect();
        let turns: Vec<f64> = self.oriented.iter().flat_map(|link| pose.quat[*link]).collect();
        Ok((
            PyArray1::from_vec(py, points).reshape([reader.points.len(), 3])?,
            PyArray1::from_vec(py, turns).reshape([self.oriented.len(), 4])?,
            PyArray1::from_slice(py, &pose.com),
        ))
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
    fn new(
        body: &PyBody,
        links: Vec<usize>,
        local: PyReadonlyArray2<'_, f64>,
        planted: PyReadonlyArray2<'_, f64>,
        edges: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Self> {
        let reader = Reader::new(body, &links, &local)?;
        let planted = table(&planted, links.len(), 3, "planted")?.chunks_exact(3).map(triple).collect();
        let edges = table(&edges, edges.shape()[0], 3, "edges")?.chunks_exact(3).map(triple).collect();
        Ok(Self { reader, planted, edges })
    }

    fn losses(&mut self, way: PyReadonlyArray2<'_, f64>) -> PyResult<(f64, f64)> {
        let nq = self.reader.body.nq;
        if way.shape()[1] != nq || !way.is_c_contiguous() {
            return Err(bad(format!("a way has {} columns, the body {nq} (C-contiguous)", way.shape()[1])));
        }
        let (mut off, mut inside) = (0.0_f64, f64::INFINITY);
        for q in way.as_slice()?.chunks_exact(nq) {
            self.reader.go_to(q);
            for (i, planted) in self.planted.iter().enumerate() {
                let gone = sub(self.reader.point(i), *planted);
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

/// The larger of two; NaN, if one of them is.
fn largest(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b {
        a
    } else {
        b
    }
}

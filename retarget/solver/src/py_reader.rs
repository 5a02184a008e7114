//! Where chosen parts of a body are, for Python.

use crate::body::Body;
use crate::kinematics::Pose;
use crate::math::Vec3;
use crate::py_arrays::{bad, table, triple};
use crate::py_body::PyBody;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use std::sync::Arc;

type Parts<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// See `retarget/_solver.pyi`.
#[pyclass(name = "BodyReader", module = "retarget._solver")]
pub struct PyBodyReader {
    body: Arc<Body>,
    pose: Pose,
    points: Vec<(usize, Vec3)>,
    oriented: Vec<usize>,
}

#[pymethods]
impl PyBodyReader {
    #[new]
    fn new(body: &PyBody, links: Vec<usize>, local: PyReadonlyArray2<'_, f64>, oriented: Vec<usize>) -> PyResult<Self> {
        let local = table(&local, links.len(), 3, "local")?;
        let count = body.body.links.len();
        if let Some(link) = links.iter().chain(&oriented).find(|link| **link >= count) {
            return Err(bad(format!("link {link} does not exist; the body has {count}")));
        }
        let points = links.iter().zip(local.chunks_exact(3)).map(|(link, at)| (*link, triple(at))).collect();
        Ok(Self { body: body.body.clone(), pose: body.body.new_pose(), points, oriented })
    }

    fn read<'py>(&mut self, py: Python<'py>, q: PyReadonlyArray1<'py, f64>) -> PyResult<Parts<'py>> {
        let q = q.as_slice()?;
        if q.len() != self.body.nq {
            return Err(bad(format!("q has {} entries, the body {}", q.len(), self.body.nq)));
        }
        self.body.forward(q, &mut self.pose);
        self.body.mass_properties(&mut self.pose);
        let points = PyArray2::zeros(py, [self.points.len(), 3], false);
        for (row, (link, at)) in points.readwrite().as_slice_mut()?.chunks_exact_mut(3).zip(&self.points) {
            row.copy_from_slice(&self.body.point(&self.pose, *link, *at));
        }
        let turns = PyArray2::zeros(py, [self.oriented.len(), 4], false);
        for (row, link) in turns.readwrite().as_slice_mut()?.chunks_exact_mut(4).zip(&self.oriented) {
            row.copy_from_slice(&self.pose.quat[*link]);
        }
        Ok((points, turns, PyArray1::from_slice(py, &self.pose.com)))
    }
}

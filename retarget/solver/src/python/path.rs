//! `PathChecker` for Python.

use super::arrays::{bad, finite, table, triple};
use super::body::PyBody;
use super::observers::PyObservers;
use crate::body::JointKind;
use crate::math::quat_unit;
use crate::observers::{Ask, ObstaclePose, Other, PathChecker};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// See `retarget/_solver.pyi`.
#[pyclass(name = "PathChecker", module = "retarget._solver")]
pub struct PyPathChecker {
    checker: PathChecker,
}

#[pymethods]
impl PyPathChecker {
    #[new]
    #[pyo3(signature = (body, observers, *, columns, sole_links, sole_points))]
    fn new(
        body: &PyBody,
        observers: &PyObservers,
        columns: PyReadonlyArray1<'_, i64>,
        sole_links: Vec<usize>,
        sole_points: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Self> {
        let body = &body.body;
        let points = table(&sole_points, sole_links.len(), 3, "sole_points")?;
        if let Some(link) = sole_links.iter().find(|link| **link >= body.links.len()) {
            return Err(bad(format!("a sole sits on link {link}, which the body does not have")));
        }
        let columns: Vec<usize> =
            columns.as_slice()?.iter().map(|c| usize::try_from(*c).unwrap_or(usize::MAX)).collect();
        let single = |column: &usize| {
            let joint = body.joints.iter().find(|j| j.q_address == *column && j.kind.size() == (1, 1));
            joint.map(|j| j.v_address).ok_or_else(|| bad(format!("column {column} is no hinge and no slide")))
        };
        let movers = columns.iter().map(single).collect::<PyResult<Vec<usize>>>()?;
        if movers.is_empty() {
            return Err(bad("a path needs a joint that moves".into()));
        }
        let soles = sole_links.iter().zip(points.chunks_exact(3)).map(|(link, p)| (*link, triple(p))).collect();
        let checker = PathChecker::new(body.clone(), observers.set.clone(), &movers, columns, soles);
        Ok(Self { checker })
    }

    fn set_obstacles(
        &mut self,
        position: PyReadonlyArray2<'_, f64>,
        quat: PyReadonlyArray2<'_, f64>,
        linear: PyReadonlyArray2<'_, f64>,
        angular: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<()> {
        let obstacles = &mut self.checker.stage.obstacles;
        let k = obstacles.len();
        let (position, quat) = (table(&position, k, 3, "position")?, table(&quat, k, 4, "quat")?);
        let (linear, angular) = (table(&linear, k, 3, "linear")?, table(&angular, k, 3, "angular")?);
        for (i, obstacle) in obstacles.iter_mut().enumerate() {
            *obstacle = ObstaclePose {
                position: triple(&position[3 * i..]),
                quat: quat_unit([quat[4 * i], quat[4 * i + 1], quat[4 * i + 2], quat[4 * i + 3]]),
                linear: triple(&linear[3 * i..]),
                angular: triple(&angular[3 * i..]),
            };
        }
        Ok(())
    }

    fn restart(&mut self) {
        self.checker.restart();
    }

    /// Numbers of the observer, and of the other one or of the obstacle.
    #[getter]
    fn refused(&self) -> Option<(usize, Option<usize>, Option<usize>)> {
        let pair = &self.checker.stage.set.pairs[self.checker.refused?];
        Some(match pair.other {
            Other::Observer(other) => (pair.observer, Some(other), None),
            Other::Obstacle(obstacle) => (pair.observer, None, Some(obstacle)),
        })
    }

    #[pyo3(signature = (standing, path, *, dt, share, instead=None, remember=true))]
    fn is_clear(
        &mut self,
        standing: PyReadonlyArray1<'_, f64>,
        path: PyReadonlyArray2<'_, f64>,
        dt: f64,
        share: f64,
        instead: Option<PyReadonlyArray2<'_, f64>>,
        remember: bool,
    ) -> PyResult<bool> {
        let standing = self.posture(&standing)?;
        let path = self.rows(&path)?;
        let instead = match &instead {
            Some(rows) => Some(self.rows(rows)?),
            None => None,
        };
        if !(dt > 0.0) || !dt.is_finite() {
            return Err(bad(format!("dt is {dt}, expected a positive time in seconds")));
        }
        if !(0.0..=1.0).contains(&share) {
            return Err(bad(format!("share is {share}, expected 0 to 1")));
        }
        let ask = Ask { share, remember };
        Ok(self.checker.is_clear(standing, path, instead, dt, ask))
    }

    fn planted<'py>(
        &mut self,
        py: Python<'py>,
        standing: PyReadonlyArray1<'py, f64>,
        values: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let standing = self.posture(&standing)?;
        let values = values.as_slice()?;
        finite(values, "values")?;
        if values.len() != self.checker.stage.columns.len() {
            return Err(bad(format!("{} values for {} joints", values.len(), self.checker.stage.columns.len())));
        }
        let mut q = standing.to_vec();
        for (column, value) in self.checker.stage.columns.iter().zip(values) {
            q[*column] = *value;
        }
        let free = self.checker.stage.body.joints.iter().find(|j| j.kind == JointKind::Free);
        if let Some((link, address)) = free.map(|j| (j.body, j.q_address)) {
            let (position, quat) = self.checker.stage.root(standing, values, link);
            q[address..address + 3].copy_from_slice(&position);
            q[address + 3..address + 7].copy_from_slice(&quat);
        }
        Ok(PyArray1::from_vec(py, q))
    }
}

impl PyPathChecker {
    fn posture<'a>(&self, q: &'a PyReadonlyArray1<'_, f64>) -> PyResult<&'a [f64]> {
        let (q, nq) = (q.as_slice()?, self.checker.stage.body.nq);
        if q.len() != nq {
            return Err(bad(format!("q has {} entries, the body {nq}", q.len())));
        }
        finite(q, "q")?;
        Ok(q)
    }

    fn rows<'a>(&self, path: &'a PyReadonlyArray2<'_, f64>) -> PyResult<&'a [f64]> {
        if path.shape()[0] == 0 {
            return Err(bad("a path needs a row".into()));
        }
        table(path, path.shape()[0], self.checker.stage.columns.len(), "path")
    }
}

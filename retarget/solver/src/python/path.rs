//! `PathChecker` for Python.

use super::arrays::{bad, finite, index, table, time_step, vector, Integers, Numbers, Table};
use super::body::{points, PyBody};
use super::observers::{obstacle_poses, PyObservers};
use crate::observers::path::LOOKS;
use crate::observers::{Other, PathChecker};
use numpy::PyUntypedArrayMethods;
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
        columns: Integers<'_>,
        sole_links: Vec<usize>,
        sole_points: Table<'_>,
    ) -> PyResult<Self> {
        let body = &body.body;
        let soles = points(body, &sole_links, &sole_points, "sole_points")?;
        let columns: Vec<usize> = columns.as_slice()?.iter().map(|c| index(*c)).collect();
        let single = |column: &usize| {
            let joint = body.joints.iter().find(|j| j.q_address == *column && j.kind.size() == (1, 1));
            joint.map(|j| j.v_address).ok_or_else(|| bad(format!("column {column} is no hinge and no slide")))
        };
        let movers = columns.iter().map(single).collect::<PyResult<Vec<usize>>>()?;
        if movers.is_empty() {
            return Err(bad("a path needs a joint that moves".into()));
        }
        let checker = PathChecker::new(body.clone(), observers.set.clone(), &movers, columns, soles);
        Ok(Self { checker })
    }

    fn set_obstacles(
        &mut self,
        position: Table<'_>,
        quat: Table<'_>,
        linear: Table<'_>,
        angular: Table<'_>,
    ) -> PyResult<()> {
        let obstacles = &mut self.checker.scene.obstacles;
        *obstacles = obstacle_poses(obstacles.len(), &position, &quat, Some(&linear), Some(&angular))?;
        Ok(())
    }

    fn restart(&mut self) {
        self.checker.restart();
    }

    /// Numbers of the observer, and of the other one or of the obstacle.
    #[getter]
    fn refused(&self) -> Option<(usize, Option<usize>, Option<usize>)> {
        let pair = &self.checker.scene.set.pairs[self.checker.refused?];
        Some(match pair.other {
            Other::Observer(other) => (pair.observer, Some(other), None),
            Other::Obstacle(obstacle) => (pair.observer, None, Some(obstacle)),
        })
    }

    #[pyo3(signature = (standing, path, *, dt, share, instead=None, remember=true, looks=LOOKS))]
    #[allow(clippy::too_many_arguments)]
    fn is_clear(
        &mut self,
        standing: Numbers<'_>,
        path: Table<'_>,
        dt: f64,
        share: f64,
        instead: Option<Table<'_>>,
        remember: bool,
        looks: u64,
    ) -> PyResult<bool> {
        self.checker.most_looks = looks;
        let standing = vector(&standing, self.checker.scene.body.nq, "standing")?;
        let path = self.rows(&path)?;
        let instead = instead.as_ref().map(|rows| self.rows(rows)).transpose()?;
        if !(0.0..=1.0).contains(&share) {
            return Err(bad(format!("share is {share}, expected 0 to 1")));
        }
        Ok(self.checker.is_clear(standing, path, instead, time_step(dt)?, (share, remember)))
    }
}

impl PyPathChecker {
    fn rows<'a>(&self, path: &'a Table<'_>) -> PyResult<&'a [f64]> {
        if path.shape()[0] == 0 {
            return Err(bad("a path needs a row".into()));
        }
        let rows = table(path, path.shape()[0], self.checker.scene.columns.len(), "path")?;
        finite(rows, "path")?;
        Ok(rows)
    }
}

//! Limits and braking for Python.

use super::arrays::{bad, entries, table, time_step, vector, Matrix, Numbers, Table, Vector};
use crate::braking::{self, Braking, Limit};
use numpy::{PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Limits of every coordinate. Raises ValueError for NaN, negative speeds and lower > upper.
pub fn limits(lower: &Numbers, upper: &Numbers, velocity: &Numbers, acceleration: &Numbers) -> PyResult<Vec<Limit>> {
    let lower = lower.as_slice()?;
    let (n, upper) = (lower.len(), entries(upper, lower.len(), "upper")?);
    let velocity = entries(velocity, n, "max_velocity")?;
    let acceleration = entries(acceleration, n, "max_acceleration")?;
    let limit = |i: usize| {
        let limit = Limit { lower: lower[i], upper: upper[i], velocity: velocity[i], acceleration: acceleration[i] };
        if !(limit.lower <= limit.upper && limit.velocity >= 0.0 && limit.acceleration >= 0.0) {
            return Err(bad(format!("{limit:?} of coordinate {i}: lower above upper, or speeds below 0")));
        }
        Ok(limit)
    };
    (0..n).map(limit).collect()
}

/// See `retarget/_solver.pyi`.
#[pyfunction]
pub fn braking_displacement(gap: f64, change: f64) -> f64 {
    braking::braking_displacement(gap, change)
}

/// See `retarget/_solver.pyi`.
#[pyclass(name = "Braking", module = "retarget._solver")]
pub struct PyBraking {
    braking: Braking,
}

#[pymethods]
impl PyBraking {
    #[new]
    #[pyo3(signature = (lower, upper, max_velocity, max_acceleration, *, dt))]
    fn new(
        lower: Numbers<'_>,
        upper: Numbers<'_>,
        max_velocity: Numbers<'_>,
        max_acceleration: Numbers<'_>,
        dt: f64,
    ) -> PyResult<Self> {
        let limits = limits(&lower, &upper, &max_velocity, &max_acceleration)?;
        let ends = [("lower", &lower), ("upper", &upper)];
        let rates = [("max_velocity", &max_velocity), ("max_acceleration", &max_acceleration)];
        for (name, values) in ends.into_iter().chain(rates) {
            vector(values, limits.len(), name)?;
        }
        if limits.iter().any(|l| l.velocity == 0.0 || l.acceleration == 0.0) {
            return Err(bad("max_velocity and max_acceleration must be positive".into()));
        }
        Ok(Self { braking: Braking::new(limits, time_step(dt)?) })
    }

    fn bounds<'py>(
        &self,
        py: Python<'py>,
        position: Numbers<'py>,
        displacement: Numbers<'py>,
    ) -> PyResult<(Vector<'py>, Vector<'py>)> {
        let (position, displacement) = (self.joints(&position)?, self.joints(&displacement)?);
        let bounds = |i: usize| self.braking.bounds(i, position[i], displacement[i]);
        let (low, high) = (0..position.len()).map(bounds).unzip();
        Ok((PyArray1::from_vec(py, low), PyArray1::from_vec(py, high)))
    }

    fn ticks(&self, displacement: Numbers<'_>) -> PyResult<f64> {
        Ok(self.braking.ticks(self.joints(&displacement)?))
    }

    #[pyo3(signature = (position, displacement, goal, *, tolerance))]
    fn accepted<'py>(
        &self,
        py: Python<'py>,
        position: Numbers<'py>,
        displacement: Numbers<'py>,
        goal: Numbers<'py>,
        tolerance: f64,
    ) -> PyResult<Option<Vector<'py>>> {
        let (position, displacement) = (self.joints(&position)?, self.joints(&displacement)?);
        let goal = goal.as_slice()?;
        if goal.len() != self.braking.joints() || !goal.iter().all(|v| v.is_finite()) {
            return Ok(None);
        }
        let one = |i: usize| self.braking.accepted(i, position[i], displacement[i], goal[i], tolerance);
        let accepted: Option<Vec<f64>> = (0..goal.len()).map(one).collect();
        Ok(accepted.map(|all| PyArray1::from_vec(py, all)))
    }

    fn stop<'py>(&self, py: Python<'py>, position: Numbers<'py>, displacement: Numbers<'py>) -> PyResult<Matrix<'py>> {
        let path = self.braking.stop(self.joints(&position)?, self.joints(&displacement)?);
        let rows = path.len() / self.braking.joints();
        PyArray1::from_vec(py, path).reshape([rows, self.braking.joints()])
    }

    #[pyo3(signature = (position, displacement, path, *, tolerance))]
    fn keeps(
        &self,
        position: Numbers<'_>,
        displacement: Numbers<'_>,
        path: Table<'_>,
        tolerance: f64,
    ) -> PyResult<bool> {
        let rows = table(&path, path.shape()[0], self.braking.joints(), "path")?;
        let (position, displacement) = (self.joints(&position)?, self.joints(&displacement)?);
        Ok(rows.iter().all(|v| v.is_finite()) && self.braking.keeps(position, displacement, rows, tolerance))
    }
}

impl PyBraking {
    fn joints<'a>(&self, a: &'a Numbers<'_>) -> PyResult<&'a [f64]> {
        entries(a, self.braking.joints(), "a vector of the joints")
    }
}

//! `Braking` for Python.

use super::arrays::bad;
use super::bounds::limits;
use crate::braking::Braking;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

type Vector<'py> = Bound<'py, PyArray1<f64>>;
type Table<'py> = Bound<'py, PyArray2<f64>>;

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
        lower: PyReadonlyArray1<'_, f64>,
        upper: PyReadonlyArray1<'_, f64>,
        max_velocity: PyReadonlyArray1<'_, f64>,
        max_acceleration: PyReadonlyArray1<'_, f64>,
        dt: f64,
    ) -> PyResult<Self> {
        let limits =
            limits(lower.as_slice()?, upper.as_slice()?, max_velocity.as_slice()?, max_acceleration.as_slice()?)?;
        let rates = limits.iter().flat_map(|l| [l.velocity, l.acceleration]);
        if rates.chain([dt]).any(|v| !(v > 0.0) || !v.is_finite()) {
            return Err(bad("max_velocity, max_acceleration and dt must be positive and finite".into()));
        }
        if limits.iter().any(|l| !l.lower.is_finite() || !l.upper.is_finite()) {
            return Err(bad("lower and upper must be finite".into()));
        }
        Ok(Self { braking: Braking::new(limits, dt) })
    }

    fn bounds<'py>(
        &self,
        py: Python<'py>,
        position: PyReadonlyArray1<'py, f64>,
        displacement: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(Vector<'py>, Vector<'py>)> {
        let (position, displacement) = (self.joints(&position)?, self.joints(&displacement)?);
        let both: Vec<_> =
            (0..self.braking.joints()).map(|i| self.braking.bounds(i, position[i], displacement[i])).collect();
        Ok((PyArray1::from_iter(py, both.iter().map(|b| b.0)), PyArray1::from_iter(py, both.iter().map(|b| b.1))))
    }

    fn braked<'py>(&self, py: Python<'py>, displacement: PyReadonlyArray1<'py, f64>) -> PyResult<Vector<'py>> {
        Ok(PyArray1::from_vec(py, self.slower(self.joints(&displacement)?)))
    }

    #[pyo3(signature = (position, displacement, goal, *, tolerance))]
    fn admitted<'py>(
        &self,
        py: Python<'py>,
        position: PyReadonlyArray1<'py, f64>,
        displacement: PyReadonlyArray1<'py, f64>,
        goal: PyReadonlyArray1<'py, f64>,
        tolerance: f64,
    ) -> PyResult<Option<Vector<'py>>> {
        let (position, displacement) = (self.joints(&position)?, self.joints(&displacement)?);
        let goal = goal.as_slice()?;
        if goal.len() != self.braking.joints() || !goal.iter().all(|v| v.is_finite()) {
            return Ok(None);
        }
        let one = |i: usize| self.braking.admitted(i, position[i], displacement[i], goal[i], tolerance);
        let admitted: Option<Vec<f64>> = (0..goal.len()).map(one).collect();
        Ok(admitted.map(|all| PyArray1::from_vec(py, all)))
    }

    /// The path of a displacement, and that of braking from the one before.
    fn paths<'py>(
        &self,
        py: Python<'py>,
        position: PyReadonlyArray1<'py, f64>,
        before: PyReadonlyArray1<'py, f64>,
        displacement: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(Table<'py>, Table<'py>)> {
        let (position, displacement) = (self.joints(&position)?, self.joints(&displacement)?);
        let braked = self.slower(self.joints(&before)?);
        let table = |displacement: &[f64]| {
            let path = self.braking.path(position, displacement);
            PyArray1::from_vec(py, path).reshape([self.braking.rows, self.braking.joints()])
        };
        Ok((table(displacement)?, table(&braked)?))
    }
}

impl PyBraking {
    fn joints<'a>(&self, a: &'a PyReadonlyArray1<'_, f64>) -> PyResult<&'a [f64]> {
        let (a, n) = (a.as_slice()?, self.braking.joints());
        if a.len() != n {
            return Err(bad(format!("{} values for {n} joints", a.len())));
        }
        Ok(a)
    }

    fn slower(&self, displacement: &[f64]) -> Vec<f64> {
        displacement.iter().enumerate().map(|(i, d)| self.braking.braked(i, *d)).collect()
    }
}

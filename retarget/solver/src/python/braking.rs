//! Limits and braking for Python: the gate and the solver share one rule.

use super::arrays::{bad, finite};
use crate::braking::{self, Braking, Limit};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

type Vector<'py> = Bound<'py, PyArray1<f64>>;
type Table<'py> = Bound<'py, PyArray2<f64>>;

/// Limits of every coordinate; raises on NaN, on negative speeds and on lower > upper.
pub fn limits(lower: &[f64], upper: &[f64], velocity: &[f64], acceleration: &[f64]) -> PyResult<Vec<Limit>> {
    let n = lower.len();
    if upper.len() != n || velocity.len() != n || acceleration.len() != n {
        return Err(bad(format!(
            "limits differ in length: {n}, {}, {}, {}",
            upper.len(),
            velocity.len(),
            acceleration.len()
        )));
    }
    (0..n)
        .map(|i| {
            if !(lower[i] <= upper[i]) {
                return Err(bad(format!(
                    "limits of coordinate {i}: lower {} is not below upper {}",
                    lower[i], upper[i]
                )));
            }
            if !(velocity[i] >= 0.0) || !(acceleration[i] >= 0.0) {
                return Err(bad(format!(
                    "limits of coordinate {i}: velocity {} and acceleration {} must not be negative",
                    velocity[i], acceleration[i]
                )));
            }
            Ok(Limit { lower: lower[i], upper: upper[i], velocity: velocity[i], acceleration: acceleration[i] })
        })
        .collect()
}

/// See `retarget/_solver.pyi`.
#[pyfunction]
pub fn braking_displacement(gap: f64, change: f64) -> f64 {
    braking::braking_displacement(gap, change)
}

/// Displacement box (lo, hi) of one frame; see `retarget/_solver.pyi`.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn frame_bounds<'py>(
    py: Python<'py>,
    q: PyReadonlyArray1<'py, f64>,
    displacement_before: PyReadonlyArray1<'py, f64>,
    lower: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
    max_velocity: PyReadonlyArray1<'py, f64>,
    max_acceleration: PyReadonlyArray1<'py, f64>,
    dt: f64,
) -> PyResult<(Vector<'py>, Vector<'py>)> {
    let limits = limits(lower.as_slice()?, upper.as_slice()?, max_velocity.as_slice()?, max_acceleration.as_slice()?)?;
    let (q, before) = (q.as_slice()?, displacement_before.as_slice()?);
    if q.len() != limits.len() || before.len() != limits.len() {
        return Err(bad(format!(
            "q has {}, displacement_before {}, the limits {} entries",
            q.len(),
            before.len(),
            limits.len()
        )));
    }
    if !(dt > 0.0) || !dt.is_finite() {
        return Err(bad(format!("dt is {dt}, expected a positive time in seconds")));
    }
    finite(q, "q")?;
    finite(before, "displacement_before")?;
    let boxes: Vec<_> = (0..q.len()).map(|i| braking::frame_bounds(q[i], before[i], &limits[i], dt)).collect();
    Ok((PyArray1::from_iter(py, boxes.iter().map(|b| b.lo)), PyArray1::from_iter(py, boxes.iter().map(|b| b.hi))))
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

    fn in_line<'py>(&self, py: Python<'py>, displacement: PyReadonlyArray1<'py, f64>) -> PyResult<Vector<'py>> {
        Ok(PyArray1::from_vec(py, self.braking.in_line(self.joints(&displacement)?)))
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

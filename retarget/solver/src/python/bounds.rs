//! `frame_bounds` for Python: the gate and the solver share one rule.

use super::arrays::{bad, finite};
use crate::bounds::{frame_bounds as bounds_of, Limit};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

type Bounds<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

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
) -> PyResult<Bounds<'py>> {
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
    let boxes: Vec<_> = (0..q.len()).map(|i| bounds_of(q[i], before[i], &limits[i], dt)).collect();
    Ok((PyArray1::from_iter(py, boxes.iter().map(|b| b.lo)), PyArray1::from_iter(py, boxes.iter().map(|b| b.hi))))
}

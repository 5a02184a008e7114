//! Checks of arrays that come from Python.

use crate::math::Vec3;
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pub fn bad(message: String) -> PyErr {
    PyValueError::new_err(message)
}

pub fn triple(a: &[f64]) -> Vec3 {
    [a[0], a[1], a[2]]
}

pub fn table<'a>(a: &'a PyReadonlyArray2<'_, f64>, rows: usize, columns: usize, what: &str) -> PyResult<&'a [f64]> {
    if a.shape() != [rows, columns] {
        return Err(bad(format!("{what} has shape {:?}, expected ({rows}, {columns})", a.shape())));
    }
    // `as_slice` also takes column-major arrays, in the order of their memory.
    if !a.is_c_contiguous() {
        return Err(bad(format!("{what} must be C-contiguous")));
    }
    let slice = a.as_slice()?;
    finite(slice, what)?;
    Ok(slice)
}

pub fn finite(a: &[f64], what: &str) -> PyResult<()> {
    match a.iter().position(|v| !v.is_finite()) {
        Some(i) => Err(bad(format!("{what}[{i}] is {}, expected a finite number", a[i]))),
        None => Ok(()),
    }
}

/// Rows of `WIDTH` numbers, NaN allowed.
pub fn numbers<'a, const WIDTH: usize>(
    a: &'a PyReadonlyArray2<'_, f64>,
    count: usize,
    what: &str,
) -> PyResult<&'a [[f64; WIDTH]]> {
    if a.shape() != [count, WIDTH] || !a.is_c_contiguous() {
        return Err(bad(format!("{what} has shape {:?}, expected ({count}, {WIDTH}), C-contiguous", a.shape())));
    }
    Ok(a.as_slice()?.as_chunks::<WIDTH>().0)
}

/// Indices below `count`.
pub fn indices<'a>(a: &'a PyReadonlyArray1<'_, i64>, count: usize) -> PyResult<&'a [i64]> {
    let a = a.as_slice()?;
    match a.iter().find(|i| !(0..count as i64).contains(*i)) {
        Some(i) => Err(bad(format!("row {i} does not exist; there are {count}"))),
        None => Ok(a),
    }
}

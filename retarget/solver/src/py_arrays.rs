//! Checks of arrays that come from Python.

use crate::math::Vec3;
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
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

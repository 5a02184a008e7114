//! Checked arrays from Python, and arrays for Python.

use numpy::{Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pub type Numbers<'py> = PyReadonlyArray1<'py, f64>;
pub type Table<'py> = PyReadonlyArray2<'py, f64>;
pub type Integers<'py> = PyReadonlyArray1<'py, i64>;
pub type Flags<'py> = PyReadonlyArray1<'py, bool>;
/// Arrays that are returned.
pub type Vector<'py> = Bound<'py, PyArray1<f64>>;
pub type Matrix<'py> = Bound<'py, PyArray2<f64>>;

pub fn bad(message: String) -> PyErr {
    PyValueError::new_err(message)
}

/// `count` entries of any value.
pub fn entries<'a, T: Element>(a: &'a PyReadonlyArray1<'_, T>, count: usize, name: &str) -> PyResult<&'a [T]> {
    let a = a.as_slice()?;
    if a.len() != count {
        return Err(bad(format!("{name} has {} entries, expected {count}", a.len())));
    }
    Ok(a)
}

/// `count` finite numbers.
pub fn vector<'a>(a: &'a Numbers<'_>, count: usize, name: &str) -> PyResult<&'a [f64]> {
    let a = entries(a, count, name)?;
    finite(a, name)?;
    Ok(a)
}

/// Finite numbers, or zeros if none are given.
pub fn vector_or_zeros(a: Option<&Numbers<'_>>, count: usize, name: &str) -> PyResult<Vec<f64>> {
    a.map_or(Ok(vec![0.0; count]), |a| Ok(vector(a, count, name)?.to_vec()))
}

pub fn finite(a: &[f64], name: &str) -> PyResult<()> {
    match a.iter().position(|v| !v.is_finite()) {
        Some(i) => Err(bad(format!("{name}[{i}] is {}, expected a finite number", a[i]))),
        None => Ok(()),
    }
}

/// `count` rows of `columns` numbers, NaN allowed, one after the other.
pub fn table<'a>(a: &'a Table<'_>, count: usize, columns: usize, name: &str) -> PyResult<&'a [f64]> {
    // `as_slice` also takes column-major arrays, in the order of their memory.
    if a.shape() != [count, columns] || !a.is_c_contiguous() {
        return Err(bad(format!("{name} has shape {:?}, expected ({count}, {columns}), C-contiguous", a.shape())));
    }
    Ok(a.as_slice()?)
}

/// `count` rows of `WIDTH` numbers, NaN allowed.
pub fn numbers<'a, const WIDTH: usize>(a: &'a Table<'_>, count: usize, name: &str) -> PyResult<&'a [[f64; WIDTH]]> {
    Ok(table(a, count, WIDTH, name)?.as_chunks::<WIDTH>().0)
}

/// `count` rows of `WIDTH` finite numbers.
pub fn rows<'a, const WIDTH: usize>(a: &'a Table<'_>, count: usize, name: &str) -> PyResult<&'a [[f64; WIDTH]]> {
    let rows = numbers(a, count, name)?;
    finite(rows.as_flattened(), name)?;
    Ok(rows)
}

/// Indices below `count`.
pub fn indices<'a>(a: &'a Integers<'_>, count: usize) -> PyResult<&'a [i64]> {
    let a = a.as_slice()?;
    match a.iter().find(|i| !(0..count as i64).contains(*i)) {
        Some(i) => Err(bad(format!("row {i} does not exist; there are {count}"))),
        None => Ok(a),
    }
}

/// An index whose range the callee checks; a negative one is out of any range.
pub fn index(i: i64) -> usize {
    usize::try_from(i).unwrap_or(usize::MAX)
}

/// A time step in s.
pub fn time_step(dt: f64) -> PyResult<f64> {
    if !(dt > 0.0) || !dt.is_finite() {
        return Err(bad(format!("dt is {dt}, expected a positive time in seconds")));
    }
    Ok(dt)
}

/// An array of rows (n, WIDTH).
pub fn matrix<'py, const WIDTH: usize>(py: Python<'py>, rows: &[[f64; WIDTH]]) -> PyResult<Matrix<'py>> {
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), WIDTH])
}

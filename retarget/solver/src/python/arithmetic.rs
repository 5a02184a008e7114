//! Arithmetic for Python with the same bits on every processor: elementary functions of the crate `libm`, sums in the order of their
//! indices, no product fused with a sum. See `retarget/_solver.pyi`.

use super::arrays::bad;
use crate::math::{add, add_scaled, cross, quat_mul, scale, Quat, Vec3};
use numpy::ndarray::{ArrayD, ArrayViewD, IxDyn, Zip};
use numpy::{IntoPyArray, PyArrayDyn, PyReadonlyArray1, PyReadonlyArrayDyn, PyUntypedArray};
use pyo3::prelude::*;
use pyo3::types::PyFloat;

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(sin, m)?)?;
    m.add_function(wrap_pyfunction!(cos, m)?)?;
    m.add_function(wrap_pyfunction!(arcsin, m)?)?;
    m.add_function(wrap_pyfunction!(arccos, m)?)?;
    m.add_function(wrap_pyfunction!(exp, m)?)?;
    m.add_function(wrap_pyfunction!(expm1, m)?)?;
    m.add_function(wrap_pyfunction!(log, m)?)?;
    m.add_function(wrap_pyfunction!(arctan2, m)?)?;
    m.add_function(wrap_pyfunction!(hypot, m)?)?;
    m.add_function(wrap_pyfunction!(dot, m)?)?;
    m.add_function(wrap_pyfunction!(norm, m)?)?;
    m.add_function(wrap_pyfunction!(norms, m)?)?;
    m.add_function(wrap_pyfunction!(squares, m)?)?;
    m.add_function(wrap_pyfunction!(matmul, m)?)?;
    m.add_function(wrap_pyfunction!(quat_multiply, m)?)?;
    m.add_function(wrap_pyfunction!(quat_rotate, m)?)
}

/// A number, or an array of any shape.
pub enum Value<'py> {
    Number(f64),
    Array(PyReadonlyArrayDyn<'py, f64>),
}

impl<'a, 'py> FromPyObject<'a, 'py> for Value<'py> {
    type Error = PyErr;

    /// Floats of Python and NumPy first, which is quickest; then arrays.
    fn extract(given: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        if given.cast::<PyFloat>().is_err() && given.cast::<PyUntypedArray>().is_ok() {
            return Ok(Self::Array(given.extract()?));
        }
        given.extract().map(Self::Number)
    }
}

type Array<'py> = PyReadonlyArrayDyn<'py, f64>;
/// A number or an array.
type Answer<'py> = PyResult<Bound<'py, PyAny>>;
type Arrays<'py> = PyResult<Bound<'py, PyArrayDyn<f64>>>;

/// A number for an array without axes, else the array.
fn answer(py: Python<'_>, found: ArrayD<f64>) -> Answer<'_> {
    match found.ndim() {
        0 => Ok(found[IxDyn(&[])].into_pyobject(py)?.into_any()),
        _ => Ok(found.into_pyarray(py).into_any()),
    }
}

fn each<'py>(py: Python<'py>, x: &Value<'py>, function: impl Fn(f64) -> f64) -> Answer<'py> {
    match x {
        Value::Number(x) => Ok(function(*x).into_pyobject(py)?.into_any()),
        Value::Array(x) => answer(py, x.as_array().mapv(function)),
    }
}

fn each_pair<'py>(py: Python<'py>, x: &Value<'py>, y: &Value<'py>, function: impl Fn(f64, f64) -> f64) -> Answer<'py> {
    match (x, y) {
        (Value::Number(x), Value::Number(y)) => Ok(function(*x, *y).into_pyobject(py)?.into_any()),
        (Value::Number(x), Value::Array(y)) => answer(py, y.as_array().mapv(|y| function(*x, y))),
        (Value::Array(x), Value::Number(y)) => answer(py, x.as_array().mapv(|x| function(x, *y))),
        (Value::Array(x), Value::Array(y)) => {
            let (x, y) = (x.as_array(), y.as_array());
            let shape = IxDyn(&broadcast(x.shape(), y.shape())?);
            let mut found = ArrayD::zeros(shape.clone());
            let spread = |a: &ArrayViewD<'_, f64>| a.broadcast(shape.clone()).map(|a| a.to_owned());
            let (Some(x), Some(y)) = (spread(&x), spread(&y)) else { return Err(unlike(x.shape(), y.shape())) };
            Zip::from(&mut found).and(&x).and(&y).for_each(|out, x, y| *out = function(*x, *y));
            answer(py, found)
        }
    }
}

fn unlike(a: &[usize], b: &[usize]) -> PyErr {
    bad(format!("shapes {a:?} and {b:?} do not fit each other"))
}

/// The shape of both, as NumPy broadcasts.
fn broadcast(a: &[usize], b: &[usize]) -> PyResult<Vec<usize>> {
    let count = a.len().max(b.len());
    let axis = |shape: &[usize], k: usize| if k + shape.len() < count { 1 } else { shape[k + shape.len() - count] };
    (0..count)
        .map(|k| match (axis(a, k), axis(b, k)) {
            (one, other) if one == other || other == 1 => Ok(one),
            (1, other) => Ok(other),
            _ => Err(unlike(a, b)),
        })
        .collect()
}

/// Apply `function` to rows along the last axes, which have A and B entries; the axes before are broadcast.
fn each_row<'py, const A: usize, const B: usize, const OUT: usize>(
    py: Python<'py>,
    a: &Array<'py>,
    b: &Array<'py>,
    function: impl Fn([f64; A], [f64; B]) -> [f64; OUT],
) -> Arrays<'py> {
    let (a, b) = (a.as_array(), b.as_array());
    let (Some((&last_a, leading_a)), Some((&last_b, leading_b))) = (a.shape().split_last(), b.shape().split_last())
    else {
        return Err(unlike(a.shape(), b.shape()));
    };
    if (last_a, last_b) != (A, B) {
        return Err(bad(format!("the last axes have {last_a} and {last_b} entries, expected {A} and {B}")));
    }
    let leading = broadcast(leading_a, leading_b)?;
    let with = |last: usize| IxDyn(&[&leading[..], &[last]].concat());
    let (Some(a), Some(b)) = (a.broadcast(with(A)), b.broadcast(with(B))) else {
        return Err(unlike(leading_a, leading_b));
    };
    let mut found = Vec::with_capacity(leading.iter().product::<usize>() * OUT);
    for (a, b) in a.rows().into_iter().zip(b.rows()) {
        found.extend(function(std::array::from_fn(|k| a[k]), std::array::from_fn(|k| b[k])));
    }
    Ok(ArrayD::from_shape_vec(with(OUT), found).expect("as many as the shape says").into_pyarray(py))
}

/// Squared length of a row, in the order of its entries.
fn square_sum<'a>(row: impl IntoIterator<Item = &'a f64>) -> f64 {
    row.into_iter().fold(0.0, |sum, x| sum + x * x)
}

fn each_square_sum(v: &Array<'_>, function: impl Fn(f64) -> f64) -> PyResult<ArrayD<f64>> {
    let v = v.as_array();
    let Some((_, leading)) = v.shape().split_last() else {
        return Err(bad("a number has no length; expected an array of vectors".into()));
    };
    let found = v.rows().into_iter().map(|row| function(square_sum(row))).collect();
    Ok(ArrayD::from_shape_vec(IxDyn(leading), found).expect("one of each row"))
}

macro_rules! functions {
    ($($name:ident: $function:path;)*) => {$(
        #[pyfunction]
        pub fn $name<'py>(py: Python<'py>, x: Value<'py>) -> Answer<'py> {
            each(py, &x, $function)
        }
    )*};
}

functions! {
    sin: libm::sin;
    cos: libm::cos;
    arcsin: libm::asin;
    arccos: libm::acos;
    exp: libm::exp;
    expm1: libm::expm1;
    log: libm::log;
}

#[pyfunction]
pub fn arctan2<'py>(py: Python<'py>, y: Value<'py>, x: Value<'py>) -> Answer<'py> {
    each_pair(py, &y, &x, libm::atan2)
}

#[pyfunction]
pub fn hypot<'py>(py: Python<'py>, x: Value<'py>, y: Value<'py>) -> Answer<'py> {
    each_pair(py, &x, &y, libm::hypot)
}

#[pyfunction]
pub fn dot(a: PyReadonlyArray1<'_, f64>, b: PyReadonlyArray1<'_, f64>) -> PyResult<f64> {
    let (a, b) = (a.as_array(), b.as_array());
    match a.len() == b.len() {
        true => Ok(a.iter().zip(b).fold(0.0, |sum, (x, y)| sum + x * y)),
        false => Err(unlike(a.shape(), b.shape())),
    }
}

#[pyfunction]
pub fn norm(v: PyReadonlyArray1<'_, f64>) -> f64 {
    square_sum(v.as_array()).sqrt()
}

#[pyfunction]
pub fn norms<'py>(py: Python<'py>, v: Array<'py>) -> Arrays<'py> {
    Ok(each_square_sum(&v, f64::sqrt)?.into_pyarray(py))
}

#[pyfunction]
pub fn squares<'py>(py: Python<'py>, v: Array<'py>) -> Arrays<'py> {
    Ok(each_square_sum(&v, |square| square)?.into_pyarray(py))
}

#[pyfunction]
pub fn matmul<'py>(py: Python<'py>, a: Array<'py>, b: Array<'py>) -> Arrays<'py> {
    let (a, b) = (a.as_array(), b.as_array());
    let (Some((&inner, leading)), [first, columns @ ..]) = (a.shape().split_last(), b.shape()) else {
        return Err(unlike(a.shape(), b.shape()));
    };
    if inner != *first || columns.len() > 1 {
        return Err(unlike(a.shape(), b.shape()));
    }
    let (width, shape) = (columns.iter().product::<usize>(), [leading, columns].concat());
    let table: Vec<f64> = b.iter().copied().collect();
    let mut found = vec![0.0; leading.iter().product::<usize>() * width];
    if width > 0 {
        for (row, sums) in a.rows().into_iter().zip(found.chunks_exact_mut(width)) {
            for (x, factors) in row.iter().zip(table.chunks_exact(width)) {
                for (sum, factor) in sums.iter_mut().zip(factors) {
                    *sum += x * factor;
                }
            }
        }
    }
    Ok(ArrayD::from_shape_vec(IxDyn(&shape), found).expect("as many as the shape says").into_pyarray(py))
}

#[pyfunction]
pub fn quat_multiply<'py>(py: Python<'py>, a: Array<'py>, b: Array<'py>) -> Arrays<'py> {
    each_row(py, &a, &b, |a: Quat, b: Quat| quat_mul(a, b))
}

#[pyfunction]
pub fn quat_rotate<'py>(py: Python<'py>, q: Array<'py>, v: Array<'py>) -> Arrays<'py> {
    each_row(py, &q, &v, |[w, x, y, z]: Quat, v: Vec3| {
        let axis = [x, y, z];
        let turn = scale(cross(axis, v), 2.0);
        add(add_scaled(v, turn, w), cross(axis, turn))
    })
}

//! `solve_hierarchy`: one linear solve, for tests and for callers with rows of their own.

use crate::hierarchy::{solve, Problem, Workspace};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Result of one linear solve.
#[pyclass(module = "retarget._solver", frozen)]
pub struct HierarchyResult {
    x: Vec<f64>,
    #[pyo3(get)]
    level_residuals: Vec<f64>,
    #[pyo3(get)]
    factorizations: u32,
    #[pyo3(get)]
    fallback: bool,
    #[pyo3(get)]
    reduced: bool,
    #[pyo3(get)]
    capped: bool,
}

#[pymethods]
impl HierarchyResult {
    #[getter]
    fn x<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.x)
    }
}

type Level<'py> = (
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
);

fn matrix_rows<'a>(a: &'a PyReadonlyArray2<'_, f64>, what: &str) -> PyResult<Vec<&'a [f64]>> {
    let columns = a.shape()[1];
    let all = a.as_slice().map_err(|_| PyValueError::new_err(format!("{what} must be C-contiguous")))?;
    if columns == 0 {
        return Ok(vec![]);
    }
    Ok(all.chunks_exact(columns).collect())
}

fn check(condition: bool, message: impl FnOnce() -> String) -> PyResult<()> {
    if condition {
        Ok(())
    } else {
        Err(PyValueError::new_err(message()))
    }
}

/// Lexicographic least squares under a box: see `retarget/_solver.pyi`.
#[pyfunction]
#[pyo3(signature = (levels, lo, hi, *, weight=None, reference=None, soft=None, damping=0.0))]
#[allow(clippy::too_many_arguments)]
pub fn solve_hierarchy(
    py: Python<'_>,
    levels: Vec<Level<'_>>,
    lo: PyReadonlyArray1<'_, f64>,
    hi: PyReadonlyArray1<'_, f64>,
    weight: Option<PyReadonlyArray1<'_, f64>>,
    reference: Option<PyReadonlyArray1<'_, f64>>,
    soft: Option<(PyReadonlyArray2<'_, f64>, PyReadonlyArray1<'_, f64>)>,
    damping: f64,
) -> PyResult<HierarchyResult> {
    let (lo, hi) = (lo.as_slice()?, hi.as_slice()?);
    let n = lo.len();
    check(hi.len() == n && n > 0, || format!("lo has {n} entries, hi {}", hi.len()))?;
    for i in 0..n {
        check(lo[i] <= hi[i], || format!("lo[{i}] = {} is above hi[{i}] = {}", lo[i], hi[i]))?;
    }
    let weight: Vec<f64> = weight.map_or(Ok(vec![1.0; n]), |w| w.as_slice().map(<[f64]>::to_vec))?;
    let reference: Vec<f64> = reference.map_or(Ok(vec![0.0; n]), |w| w.as_slice().map(<[f64]>::to_vec))?;
    check(weight.len() == n && reference.len() == n, || "weight and reference need one entry per variable".into())?;
    check(weight.iter().all(|w| *w > 0.0 && w.is_finite()), || "every weight must be positive".into())?;
    let soft_rows = soft.as_ref().map_or(0, |(s, _)| s.shape()[0]);
    let mut sizes: Vec<usize> = vec![];
    for (c, e, d, lower, upper) in &levels {
        let (m, k) = (c.shape()[0], d.shape()[0]);
        check(e.len() == m && lower.len() == k && upper.len() == k, || {
            "a level's rows and targets differ in number".into()
        })?;
        check((m == 0 || c.shape()[1] == n) && (k == 0 || d.shape()[1] == n), || format!("rows need {n} columns"))?;
        sizes.push(m + k);
    }
    if soft_rows > 0 {
        sizes.push(soft_rows);
    }
    let mut problem = Problem::new(n + soft_rows, &sizes);
    problem.damping.fill(damping);
    problem.patience.fill(1.0);
    let mut r = 0;
    let mut put = |problem: &mut Problem, row: &[f64], lower: f64, upper: f64| {
        let shift: f64 = row.iter().zip(&reference).map(|(c, x)| c * x).sum();
        for i in 0..n {
            problem.row_mut(r)[i] = row[i] / weight[i];
        }
        problem.lower[r] = lower - shift;
        problem.upper[r] = upper - shift;
        problem.present[r] = true;
        r += 1;
    };
    for (c, e, d, lower, upper) in &levels {
        for (row, target) in matrix_rows(c, "C")?.iter().zip(e.as_slice()?) {
            put(&mut problem, row, *target, *target);
        }
        for ((row, low), high) in matrix_rows(d, "D")?.iter().zip(lower.as_slice()?).zip(upper.as_slice()?) {
            put(&mut problem, row, *low, *high);
        }
    }
    if let Some((s, t)) = &soft {
        let first = sizes.iter().sum::<usize>() - soft_rows;
        for (k, (row, target)) in matrix_rows(s, "S")?.iter().zip(t.as_slice()?).enumerate() {
            put(&mut problem, row, *target, *target);
            problem.row_mut(first + k)[n + k] = 1.0;
        }
    }
    for i in 0..n {
        problem.still[i] = -reference[i] * weight[i];
        problem.lo[i] = (lo[i] - reference[i]) * weight[i];
        problem.hi[i] = (hi[i] - reference[i]) * weight[i];
        problem.lo_is_stop[i] = lo[i].is_finite();
        problem.hi_is_stop[i] = hi[i].is_finite();
    }
    let mut work = Workspace::default();
    let outcome = py.detach(|| solve(&mut problem, &mut work));
    let x: Vec<f64> = (0..n).map(|i| (reference[i] + problem.z[i] / weight[i]).clamp(lo[i], hi[i])).collect();
    let level_residuals = levels.iter().map(|level| level_residual(level, &x)).collect::<PyResult<_>>()?;
    Ok(HierarchyResult {
        x,
        level_residuals,
        factorizations: outcome.factorizations,
        fallback: outcome.fallback,
        reduced: outcome.reduced,
        capped: outcome.capped,
    })
}

fn level_residual((c, e, d, lower, upper): &Level<'_>, x: &[f64]) -> PyResult<f64> {
    let value = |row: &[f64]| row.iter().zip(x).map(|(c, x)| c * x).sum::<f64>();
    let mut sum = 0.0;
    for (row, target) in matrix_rows(c, "C")?.iter().zip(e.as_slice()?) {
        sum += (value(row) - target).powi(2);
    }
    for ((row, low), high) in matrix_rows(d, "D")?.iter().zip(lower.as_slice()?).zip(upper.as_slice()?) {
        let v = value(row);
        sum += (low - v).max(v - high).max(0.0).powi(2);
    }
    Ok(sum.sqrt())
}

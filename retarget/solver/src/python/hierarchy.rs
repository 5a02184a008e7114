//! `solve_hierarchy`: one linear solve, for tests of the hierarchy by itself.

use super::arrays::{entries, table, Numbers, Table, Vector};
use crate::hierarchy::{solve, Outcome, Problem, Workspace};
use numpy::PyArray1;
use pyo3::prelude::*;

/// See `retarget/_solver.pyi`.
#[pyfunction]
#[pyo3(signature = (rows, lower, upper, level_sizes, *, lo, hi, still, damping))]
#[allow(clippy::too_many_arguments)]
pub fn solve_hierarchy<'py>(
    py: Python<'py>,
    rows: Table<'py>,
    lower: Numbers<'py>,
    upper: Numbers<'py>,
    level_sizes: Vec<usize>,
    lo: Numbers<'py>,
    hi: Numbers<'py>,
    still: Numbers<'py>,
    damping: f64,
) -> PyResult<(Vector<'py>, bool, bool)> {
    let (n, m) = (lo.as_slice()?.len(), level_sizes.iter().sum());
    let mut problem = Problem::new(n, &level_sizes);
    for (r, row) in table(&rows, m, n, "rows")?.chunks_exact(n).enumerate() {
        problem.row_mut(r)[..n].copy_from_slice(row);
    }
    problem.lower.copy_from_slice(entries(&lower, m, "lower")?);
    problem.upper.copy_from_slice(entries(&upper, m, "upper")?);
    problem.present.fill(true);
    problem.lo.copy_from_slice(lo.as_slice()?);
    problem.hi.copy_from_slice(entries(&hi, n, "hi")?);
    problem.still[..n].copy_from_slice(entries(&still, n, "still")?);
    problem.lo_is_stop = problem.lo.iter().map(|lo| lo.is_finite()).collect();
    problem.hi_is_stop = problem.hi.iter().map(|hi| hi.is_finite()).collect();
    problem.damping.fill(damping);
    problem.patience.fill(1.0);
    let Outcome { reduced, capped, .. } = solve(&mut problem, &mut Workspace::default());
    Ok((PyArray1::from_slice(py, &problem.z[..n]), reduced, capped))
}

//! `Observers` for Python: which shapes of a body look at each other and at which obstacles.

use super::arrays::{bad, finite, table, triple};
use super::body::PyBody;
use super::shapes::shape;
use crate::geometry::Shape;
use crate::math::{quat_to_mat, quat_unit, Mat3};
use crate::observers::{Activation, Observer, ObserverSet, Obstacle};
use crate::task::{Task, TaskKind};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::sync::Arc;

/// See `retarget/_solver.pyi`.
#[pyclass(name = "Observers", module = "retarget._solver", frozen)]
pub struct PyObservers {
    pub set: Arc<ObserverSet>,
}

#[pymethods]
impl PyObservers {
    #[new]
    #[pyo3(signature = (body, *, links, kinds, sizes, positions, quats, influence, margin, pairs, obstacle_kinds,
                        obstacle_sizes, obstacle_influence, obstacle_margin, pair_margin=None, obstacle_pairs=None,
                        obstacle_pair_margin=None))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        body: &PyBody,
        links: PyReadonlyArray1<'_, i64>,
        kinds: PyReadonlyArray1<'_, i64>,
        sizes: PyReadonlyArray2<'_, f64>,
        positions: PyReadonlyArray2<'_, f64>,
        quats: PyReadonlyArray2<'_, f64>,
        influence: PyReadonlyArray1<'_, f64>,
        margin: PyReadonlyArray1<'_, f64>,
        pairs: PyReadonlyArray2<'_, i64>,
        obstacle_kinds: PyReadonlyArray1<'_, i64>,
        obstacle_sizes: PyReadonlyArray2<'_, f64>,
        obstacle_influence: PyReadonlyArray1<'_, f64>,
        obstacle_margin: PyReadonlyArray1<'_, f64>,
        pair_margin: Option<PyReadonlyArray1<'_, f64>>,
        obstacle_pairs: Option<PyReadonlyArray2<'_, i64>>,
        obstacle_pair_margin: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Self> {
        let links = links.as_slice()?;
        let n = links.len();
        let kinds = kinds.as_slice()?;
        if kinds.len() != n {
            return Err(bad(format!("kinds has {} entries, expected {n}", kinds.len())));
        }
        let shapes = shapes(kinds, table(&sizes, n, 3, "sizes")?)?;
        let (at, quat) = (table(&positions, n, 3, "positions")?, table(&quats, n, 4, "quats")?);
        let zones = zones(influence.as_slice()?, margin.as_slice()?, n)?;
        let observers = (0..n)
            .map(|k| Observer {
                link: usize::try_from(links[k]).unwrap_or(usize::MAX),
                shape: shapes[k],
                position: triple(&at[3 * k..]),
                rotation: rotation(&quat[4 * k..]),
                influence: zones[k].0,
                margin: zones[k].1,
            })
            .collect();
        let kinds = obstacle_kinds.as_slice()?;
        let fixtures = self::shapes(kinds, table(&obstacle_sizes, kinds.len(), 3, "obstacle_sizes")?)?;
        let zones = self::zones(obstacle_influence.as_slice()?, obstacle_margin.as_slice()?, kinds.len())?;
        let obstacles = fixtures
            .iter()
            .zip(zones)
            .map(|(shape, (influence, margin))| Obstacle { shape: *shape, influence, margin })
            .collect();
        let checked = pair_rows(&pairs, pair_margin.as_ref(), "pair")?;
        let around = match &obstacle_pairs {
            Some(pairs) => pair_rows(pairs, obstacle_pair_margin.as_ref(), "obstacle_pair")?,
            // Every observer looks at every obstacle, one obstacle after the other.
            None => (0..kinds.len()).flat_map(|k| (0..n).map(move |a| (a, k, f64::INFINITY))).collect(),
        };
        let set = ObserverSet::new(&body.body, observers, obstacles, &checked, &around).map_err(bad)?;
        Ok(Self { set: Arc::new(set) })
    }

    /// Number of observers.
    #[getter]
    fn count(&self) -> usize {
        self.set.observers.len()
    }

    /// Number of obstacles.
    #[getter]
    fn obstacles(&self) -> usize {
        self.set.obstacles.len()
    }
}

fn shapes(kinds: &[i64], sizes: &[f64]) -> PyResult<Vec<Shape>> {
    let row = |(kind, size): (&i64, &[f64])| shape(*kind, triple(size), "a shape");
    kinds.iter().zip(sizes.chunks_exact(3)).map(row).collect()
}

fn zones(influence: &[f64], margin: &[f64], n: usize) -> PyResult<Vec<(f64, f64)>> {
    if influence.len() != n || margin.len() != n {
        return Err(bad(format!("influence has {} entries, margin {}, expected {n}", influence.len(), margin.len())));
    }
    for (d, m) in influence.iter().zip(margin) {
        if !(d.is_finite() && *m >= 0.0 && d > m) {
            return Err(bad(format!("influence {d} must be above margin {m}, which must not be negative")));
        }
    }
    Ok(influence.iter().copied().zip(margin.iter().copied()).collect())
}

/// Pairs (p, 2) of numbers, each with the largest margin that it keeps: `margin` (p,), without bound where it is not given.
fn pair_rows(
    pairs: &PyReadonlyArray2<'_, i64>,
    margin: Option<&PyReadonlyArray1<'_, f64>>,
    name: &str,
) -> PyResult<Vec<(usize, usize, f64)>> {
    if pairs.shape()[1] != 2 {
        return Err(bad(format!("{name}s have {} columns, expected 2", pairs.shape()[1])));
    }
    if !pairs.is_c_contiguous() {
        return Err(bad(format!("{name}s must be C-contiguous")));
    }
    let count = pairs.shape()[0];
    let unbounded = vec![f64::INFINITY; count];
    let most = match margin {
        Some(most) => most.as_slice()?,
        None => &unbounded,
    };
    if most.len() != count || most.iter().any(|m| !(*m >= 0.0)) {
        return Err(bad(format!("{name}_margin needs {count} entries that are not negative")));
    }
    let index = |k: i64| usize::try_from(k).unwrap_or(usize::MAX);
    Ok(pairs.as_slice()?.chunks_exact(2).zip(most).map(|(p, m)| (index(p[0]), index(p[1]), *m)).collect())
}

fn rotation(quat: &[f64]) -> Mat3 {
    quat_to_mat(quat_unit([quat[0], quat[1], quat[2], quat[3]]))
}

pub fn activation_named(name: &str) -> PyResult<Activation> {
    match name {
        "closest" => Ok(Activation::Closest),
        "ranked" => Ok(Activation::Ranked),
        "all" => Ok(Activation::All),
        _ => Err(bad(format!("activation is {name:?}, expected closest, ranked or all"))),
    }
}

/// Fill in the observers of tasks that name none; refuse tasks whose observers there are not, or which stand beside a posture in
/// the last level, where a row is no limit.
pub fn check_observed(levels: &mut [Vec<Task>], observers: Option<&PyObservers>) -> PyResult<()> {
    let count = observers.map_or(0, |o| o.set.observers.len());
    let last = levels.len().saturating_sub(1);
    for (k, level) in levels.iter_mut().enumerate() {
        let soft = k == last && level.iter().any(|t| matches!(t.kind, TaskKind::Posture));
        for task in level {
            let TaskKind::Observers(task) = &mut task.kind else { continue };
            if soft {
                return Err(bad("observers cannot share the last level with a posture".into()));
            }
            if task.of.len() > count && task.named {
                return Err(bad(format!("a task is of an observer that is not among the {count}")));
            }
            if !task.named {
                task.of = vec![true; count];
            }
            task.of.resize(count, false);
        }
    }
    Ok(())
}

/// Row-wise triples and quaternions of `k` obstacles, checked.
pub fn obstacle_rows<'a>(values: &'a PyReadonlyArray2<'_, f64>, k: usize, n: usize, name: &str) -> PyResult<&'a [f64]> {
    let rows = table(values, k, n, name)?;
    finite(rows, name)?;
    Ok(rows)
}

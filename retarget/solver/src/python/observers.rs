//! `Observers` for Python.

use super::arrays::{bad, entries, index, rows, Integers, Numbers, Table};
use super::body::PyBody;
use super::shapes::shapes;
use crate::math::{quat_to_mat, quat_unit};
use crate::observers::{Observer, ObserverSet, Obstacle, ObstaclePose};
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
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
        links: Integers<'_>,
        kinds: Integers<'_>,
        sizes: Table<'_>,
        positions: Table<'_>,
        quats: Table<'_>,
        influence: Numbers<'_>,
        margin: Numbers<'_>,
        pairs: PyReadonlyArray2<'_, i64>,
        obstacle_kinds: Integers<'_>,
        obstacle_sizes: Table<'_>,
        obstacle_influence: Numbers<'_>,
        obstacle_margin: Numbers<'_>,
        pair_margin: Option<Numbers<'_>>,
        obstacle_pairs: Option<PyReadonlyArray2<'_, i64>>,
        obstacle_pair_margin: Option<Numbers<'_>>,
    ) -> PyResult<Self> {
        let links = links.as_slice()?;
        let (n, k) = (links.len(), obstacle_kinds.as_slice()?.len());
        let of_links = shapes(&kinds, &sizes, n, ["kinds", "sizes"])?;
        let (at, quat) = (rows::<3>(&positions, n, "positions")?, rows::<4>(&quats, n, "quats")?);
        let zones = zones(&influence, &margin, n)?;
        let observer = |i: usize| Observer {
            link: index(links[i]),
            shape: of_links[i],
            position: at[i],
            rotation: quat_to_mat(quat_unit(quat[i])),
            influence: zones[i].0,
            margin: zones[i].1,
        };
        let fixtures = shapes(&obstacle_kinds, &obstacle_sizes, k, ["obstacle_kinds", "obstacle_sizes"])?.into_iter();
        let around = self::zones(&obstacle_influence, &obstacle_margin, k)?;
        let obstacle = |(shape, (influence, margin))| Obstacle { shape, influence, margin };
        let checked = pair_rows(&pairs, pair_margin.as_ref(), "pair")?;
        let watched = match &obstacle_pairs {
            Some(pairs) => pair_rows(pairs, obstacle_pair_margin.as_ref(), "obstacle_pair")?,
            // Every observer looks at every obstacle, one obstacle after the other.
            None => (0..k).flat_map(|k| (0..n).map(move |a| (a, k, f64::INFINITY))).collect(),
        };
        let (observers, obstacles) = ((0..n).map(observer).collect(), fixtures.zip(around).map(obstacle).collect());
        let set = ObserverSet::new(&body.body, observers, obstacles, &checked, &watched).map_err(bad)?;
        Ok(Self { set: Arc::new(set) })
    }
}

/// Influence and margin of each of `n`.
fn zones(influence: &Numbers<'_>, margin: &Numbers<'_>, n: usize) -> PyResult<Vec<(f64, f64)>> {
    let zones = entries(influence, n, "influence")?.iter().copied().zip(entries(margin, n, "margin")?.iter().copied());
    match zones.clone().find(|(d, m)| !(d.is_finite() && *m >= 0.0 && d > m)) {
        Some((d, m)) => Err(bad(format!("influence {d} must be above margin {m}, which must not be negative"))),
        None => Ok(zones.collect()),
    }
}

/// Pairs (p, 2) of numbers, each with the largest margin that it keeps: `margin` (p,), or infinity if it is not given.
fn pair_rows(
    pairs: &PyReadonlyArray2<'_, i64>,
    margin: Option<&Numbers<'_>>,
    name: &str,
) -> PyResult<Vec<(usize, usize, f64)>> {
    let count = pairs.shape()[0];
    if pairs.shape()[1] != 2 || !pairs.is_c_contiguous() {
        return Err(bad(format!("{name}s has shape {:?}, expected ({count}, 2), C-contiguous", pairs.shape())));
    }
    let unbounded = vec![f64::INFINITY; count];
    let most = margin.map_or(Ok(&unbounded[..]), |most| entries(most, count, &format!("{name}_margin")))?;
    if most.iter().any(|m| !(*m >= 0.0)) {
        return Err(bad(format!("{name}_margin needs {count} entries that are not negative")));
    }
    Ok(pairs.as_slice()?.chunks_exact(2).zip(most).map(|(p, m)| (index(p[0]), index(p[1]), *m)).collect())
}

/// Poses of `k` obstacles, at rest if no velocity is given.
pub fn obstacle_poses(
    k: usize,
    position: &Table<'_>,
    quat: &Table<'_>,
    linear: Option<&Table<'_>>,
    angular: Option<&Table<'_>>,
) -> PyResult<Vec<ObstaclePose>> {
    let (position, quat) = (rows::<3>(position, k, "position")?, rows::<4>(quat, k, "quat")?);
    let still = vec![[0.0; 3]; k];
    let linear = linear.map_or(Ok(&still[..]), |values| rows(values, k, "linear"))?;
    let angular = angular.map_or(Ok(&still[..]), |values| rows(values, k, "angular"))?;
    let pose = |i: usize| ObstaclePose {
        position: position[i],
        quat: quat_unit(quat[i]),
        linear: linear[i],
        angular: angular[i],
    };
    Ok((0..k).map(pose).collect())
}

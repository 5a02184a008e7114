//! `shape_distances`: the signed distance of many pairs of solids.

use super::arrays::{bad, table, triple};
use crate::geometry::{gap_at_least, nearest, Scratch, Shape, Solid};
use crate::math::{quat_to_mat, quat_unit, Vec3};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

type Distances<'py> =
    (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// A shape by its kind and sizes, as `retarget/_solver.pyi` has them.
pub fn shape(kind: i64, size: Vec3, name: &str) -> PyResult<Shape> {
    if size.iter().any(|side| *side < 0.0) {
        return Err(bad(format!("{name} has size {size:?}; sizes must not be negative")));
    }
    match kind {
        0 => Ok(Shape::Capsule { radius: size[0], half_length: size[1] }),
        1 => Ok(Shape::Cylinder { radius: size[0], half_length: size[1] }),
        2 => Ok(Shape::Box { half: size }),
        3 => Ok(Shape::HalfSpace),
        _ => Err(bad(format!("{name} has kind {kind}; 0 capsule, 1 cylinder, 2 box, 3 half-space"))),
    }
}

/// Solids from the arrays of one side; `side` is "a" or "b".
fn solids(
    kinds: &PyReadonlyArray1<'_, i64>,
    sizes: &PyReadonlyArray2<'_, f64>,
    positions: &PyReadonlyArray2<'_, f64>,
    quats: &PyReadonlyArray2<'_, f64>,
    side: &str,
) -> PyResult<Vec<Solid>> {
    let kinds = kinds.as_slice()?;
    let n = kinds.len();
    let sizes = table(sizes, n, 3, &format!("sizes_{side}"))?;
    let positions = table(positions, n, 3, &format!("pos_{side}"))?;
    let quats = table(quats, n, 4, &format!("quat_{side}"))?;
    (0..n)
        .map(|i| {
            let quat = [quats[4 * i], quats[4 * i + 1], quats[4 * i + 2], quats[4 * i + 3]];
            if !(quat.iter().map(|v| v * v).sum::<f64>() > 1e-24) {
                return Err(bad(format!("quat_{side}[{i}] is zero, expected a rotation")));
            }
            Ok(Solid {
                shape: shape(kinds[i], triple(&sizes[3 * i..]), &format!("solid {i} of {side}"))?,
                position: triple(&positions[3 * i..]),
                rotation: quat_to_mat(quat_unit(quat)),
            })
        })
        .collect()
}

/// Both sides, of equal number, and never two half-spaces.
fn pairs(a: Vec<Solid>, b: Vec<Solid>) -> PyResult<Vec<(Solid, Solid)>> {
    if a.len() != b.len() {
        return Err(bad(format!("kinds_a has {} entries, kinds_b {}", a.len(), b.len())));
    }
    let both: Vec<(Solid, Solid)> = a.into_iter().zip(b).collect();
    match both.iter().position(|(a, b)| a.shape == Shape::HalfSpace && b.shape == Shape::HalfSpace) {
        Some(i) => Err(bad(format!("pair {i} is two half-spaces, which have no distance"))),
        None => Ok(both),
    }
}

/// Signed distance, nearest points and direction of pairs; see `retarget/_solver.pyi`.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn shape_distances<'py>(
    py: Python<'py>,
    kinds_a: PyReadonlyArray1<'py, i64>,
    sizes_a: PyReadonlyArray2<'py, f64>,
    pos_a: PyReadonlyArray2<'py, f64>,
    quat_a: PyReadonlyArray2<'py, f64>,
    kinds_b: PyReadonlyArray1<'py, i64>,
    sizes_b: PyReadonlyArray2<'py, f64>,
    pos_b: PyReadonlyArray2<'py, f64>,
    quat_b: PyReadonlyArray2<'py, f64>,
) -> PyResult<Distances<'py>> {
    let a = solids(&kinds_a, &sizes_a, &pos_a, &quat_a, "a")?;
    let both = pairs(a, solids(&kinds_b, &sizes_b, &pos_b, &quat_b, "b")?)?;
    let n = both.len();
    let [distance, a, b, normal] = py.detach(|| {
        let mut scratch = Scratch::default();
        let mut out = [n, 3 * n, 3 * n, 3 * n].map(Vec::with_capacity);
        for (a, b) in &both {
            let found = nearest(a, b, &mut scratch);
            out[0].push(found.distance);
            out[1].extend(found.a);
            out[2].extend(found.b);
            out[3].extend(found.normal);
        }
        out
    });
    let points = |values| PyArray1::from_vec(py, values).reshape([n, 3]);
    Ok((PyArray1::from_vec(py, distance), points(a)?, points(b)?, points(normal)?))
}

/// Lower bound (N,) of the distance; see `retarget/_solver.pyi`.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn shape_gaps_at_least<'py>(
    py: Python<'py>,
    kinds_a: PyReadonlyArray1<'py, i64>,
    sizes_a: PyReadonlyArray2<'py, f64>,
    pos_a: PyReadonlyArray2<'py, f64>,
    quat_a: PyReadonlyArray2<'py, f64>,
    kinds_b: PyReadonlyArray1<'py, i64>,
    sizes_b: PyReadonlyArray2<'py, f64>,
    pos_b: PyReadonlyArray2<'py, f64>,
    quat_b: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let a = solids(&kinds_a, &sizes_a, &pos_a, &quat_a, "a")?;
    let both = pairs(a, solids(&kinds_b, &sizes_b, &pos_b, &quat_b, "b")?)?;
    let gaps: Vec<f64> = py.detach(|| both.iter().map(|(a, b)| gap_at_least(a, b)).collect());
    Ok(PyArray1::from_vec(py, gaps))
}

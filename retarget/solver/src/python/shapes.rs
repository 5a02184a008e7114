//! Shapes from arrays, and the signed distance of many pairs of solids.

use super::arrays::{bad, entries, matrix, rows, Integers, Matrix, Table, Vector};
use crate::geometry::{gap_at_least, nearest, Nearest, Scratch, Shape, Solid};
use crate::math::{quat_to_mat, quat_unit, Vec3};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// Kinds, sizes, positions and quaternions of the solids of one side, and of the other.
type Pairs<'py> =
    (Integers<'py>, Table<'py>, Table<'py>, Table<'py>, Integers<'py>, Table<'py>, Table<'py>, Table<'py>);

/// A shape by its kind and sizes, as `retarget/_solver.pyi` has them.
fn shape(kind: i64, size: Vec3) -> PyResult<Shape> {
    if size.iter().any(|side| *side < 0.0) {
        return Err(bad(format!("a shape has size {size:?}; sizes must not be negative")));
    }
    match kind {
        0 => Ok(Shape::Capsule { radius: size[0], half_length: size[1] }),
        1 => Ok(Shape::Cylinder { radius: size[0], half_length: size[1] }),
        2 => Ok(Shape::Box { half: size }),
        3 => Ok(Shape::HalfSpace),
        _ => Err(bad(format!("a shape has kind {kind}; 0 capsule, 1 cylinder, 2 box, 3 half-space"))),
    }
}

/// `count` shapes; errors call both arrays by their names.
pub fn shapes(
    kinds: &Integers,
    sizes: &Table,
    count: usize,
    [kinds_name, sizes_name]: [&str; 2],
) -> PyResult<Vec<Shape>> {
    let kinds = entries(kinds, count, kinds_name)?;
    kinds.iter().zip(rows::<3>(sizes, count, sizes_name)?).map(|(kind, size)| shape(*kind, *size)).collect()
}

fn solids(kinds: &Integers, sizes: &Table, places: &Table, quats: &Table, names: [&str; 4]) -> PyResult<Vec<Solid>> {
    let n = kinds.as_slice()?.len();
    let (places, quats) = (rows(places, n, names[2])?, rows::<4>(quats, n, names[3])?);
    if let Some(i) = quats.iter().position(|quat| !(quat.iter().map(|v| v * v).sum::<f64>() > 1e-24)) {
        return Err(bad(format!("{}[{i}] is zero, expected a rotation", names[3])));
    }
    let shapes = shapes(kinds, sizes, n, [names[0], names[1]])?.into_iter();
    let solid = |((shape, position), quat): ((Shape, &Vec3), &[f64; 4])| Solid {
        shape,
        position: *position,
        rotation: quat_to_mat(quat_unit(*quat)),
    };
    Ok(shapes.zip(places).zip(quats).map(solid).collect())
}

/// Both sides, of equal number, and never two half-spaces.
fn pairs(arrays: &Bound<'_, PyTuple>) -> PyResult<Vec<(Solid, Solid)>> {
    let (kinds_a, sizes_a, pos_a, quat_a, kinds_b, sizes_b, pos_b, quat_b): Pairs<'_> = arrays.extract()?;
    let a = solids(&kinds_a, &sizes_a, &pos_a, &quat_a, ["kinds_a", "sizes_a", "pos_a", "quat_a"])?;
    let b = solids(&kinds_b, &sizes_b, &pos_b, &quat_b, ["kinds_b", "sizes_b", "pos_b", "quat_b"])?;
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
#[pyo3(signature = (*arrays))]
pub fn shape_distances<'py>(
    py: Python<'py>,
    arrays: &Bound<'py, PyTuple>,
) -> PyResult<(Vector<'py>, Matrix<'py>, Matrix<'py>, Matrix<'py>)> {
    let both = pairs(arrays)?;
    let mut scratch = Scratch::default();
    let found: Vec<_> = py.detach(|| both.iter().map(|(a, b)| nearest(a, b, &mut scratch)).collect());
    let table = |part: fn(&Nearest) -> Vec3| matrix(py, &found.iter().map(part).collect::<Vec<_>>());
    let distance = PyArray1::from_iter(py, found.iter().map(|one| one.distance));
    Ok((distance, table(|one| one.a)?, table(|one| one.b)?, table(|one| one.normal)?))
}

/// Lower bound (N,) of the distance; see `retarget/_solver.pyi`.
#[pyfunction]
#[pyo3(signature = (*arrays))]
pub fn shape_gaps_at_least<'py>(py: Python<'py>, arrays: &Bound<'py, PyTuple>) -> PyResult<Vector<'py>> {
    let both = pairs(arrays)?;
    let gaps = py.detach(|| both.iter().map(|(a, b)| gap_at_least(a, b)).collect());
    Ok(PyArray1::from_vec(py, gaps))
}

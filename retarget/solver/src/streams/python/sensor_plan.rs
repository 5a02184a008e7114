//! Sensors out of the poses of a sender, for Python.

use crate::python::arrays::{bad, indices, numbers};
use crate::streams::sensor_plan::{Column, Parts};
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

type Poses<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<bool>>);

/// See `retarget/_solver.pyi`.
#[pyclass(name = "SensorPlan", module = "retarget._solver", frozen)]
pub struct PySensorPlan {
    count: usize,
    columns: Vec<Column>,
}

fn column(index: i64, count: usize) -> PyResult<Option<usize>> {
    match usize::try_from(index) {
        Ok(index) if index < count => Ok(Some(index)),
        Ok(_) => Err(bad(format!("column {index} does not exist; there are {count}"))),
        Err(_) => Ok(None),
    }
}

#[pymethods]
impl PySensorPlan {
    #[new]
    fn new(
        count: usize,
        points: PyReadonlyArray1<'_, i64>,
        segments: PyReadonlyArray1<'_, i64>,
        rest: PyReadonlyArray2<'_, f64>,
        offset: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Self> {
        let (points, segments) = (points.as_slice()?, segments.as_slice()?);
        let (rest, offset) =
            (numbers::<4>(&rest, points.len(), "rest")?, numbers::<3>(&offset, points.len(), "offset")?);
        if segments.len() != points.len() {
            return Err(bad(format!("segments has {} entries, expected {}", segments.len(), points.len())));
        }
        let columns = (0..points.len()).map(|i| {
            Ok(Column {
                point: column(points[i], count)?,
                segment: column(segments[i], count)?,
                rest: rest[i],
                offset: offset[i].iter().any(|x| *x != 0.0).then_some(offset[i]),
            })
        });
        Ok(Self { count, columns: columns.collect::<PyResult<_>>()? })
    }

    fn read<'py>(
        &self,
        py: Python<'py>,
        position: PyReadonlyArray2<'py, f64>,
        orientation: PyReadonlyArray2<'py, f64>,
        tracked: PyReadonlyArray1<'py, bool>,
    ) -> PyResult<Poses<'py>> {
        let (count, m) = (self.count, self.columns.len());
        let (position, orientation) =
            (numbers::<3>(&position, count, "position")?, numbers::<4>(&orientation, count, "orientation")?);
        let tracked = tracked.as_slice()?;
        if tracked.len() != count {
            return Err(bad(format!("tracked has {} entries, expected {count}", tracked.len())));
        }
        let (places, turns) = (PyArray2::zeros(py, [m, 3], false), PyArray2::zeros(py, [m, 4], false));
        let vouched = PyArray1::zeros(py, [m], false);
        {
            let (mut places, mut turns, mut vouched) = (places.readwrite(), turns.readwrite(), vouched.readwrite());
            let rows = places.as_slice_mut()?.chunks_exact_mut(3).zip(turns.as_slice_mut()?.chunks_exact_mut(4));
            for ((column, (place, turn)), vouched) in self.columns.iter().zip(rows).zip(vouched.as_slice_mut()?) {
                let (p, q, t) = column.read(position, orientation, tracked);
                place.copy_from_slice(&p);
                turn.copy_from_slice(&q);
                *vouched = t;
            }
        }
        Ok((places, turns, vouched))
    }
}

/// See `retarget/_solver.pyi`.
#[pyclass(name = "PoseParts", module = "retarget._solver")]
pub struct PyPoseParts {
    parts: Vec<Parts>,
}

#[pymethods]
impl PyPoseParts {
    #[new]
    fn new(count: usize) -> Self {
        Self { parts: vec![Parts::default(); count] }
    }

    fn complete(
        &mut self,
        rows: PyReadonlyArray1<'_, i64>,
        time: f64,
        mut position: PyReadwriteArray2<'_, f64>,
        mut orientation: PyReadwriteArray2<'_, f64>,
    ) -> PyResult<()> {
        let rows = indices(&rows, self.parts.len())?;
        if position.shape() != [rows.len(), 3] || orientation.shape() != [rows.len(), 4] {
            return Err(bad(format!("poses of {} sensors are (k, 3) and (k, 4)", rows.len())));
        }
        let places = position.as_slice_mut()?.as_chunks_mut::<3>().0;
        let turns = orientation.as_slice_mut()?.as_chunks_mut::<4>().0;
        for ((row, place), turn) in rows.iter().zip(places).zip(turns) {
            (*place, *turn) = self.parts[*row as usize].complete(time, *place, *turn);
        }
        Ok(())
    }
}

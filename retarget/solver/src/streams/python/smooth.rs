//! Smooth poses for Python.

use crate::python::arrays::{bad, numbers};
use crate::streams::smooth::{along_arc as one_arc, Cutoffs, SmoothPose};
use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

type Poses<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Orientations (k, 4) on short arcs; see `retarget/_solver.pyi`.
#[pyfunction]
pub fn along_arc<'py>(
    py: Python<'py>,
    a: PyReadonlyArray2<'py, f64>,
    b: PyReadonlyArray2<'py, f64>,
    share: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let share = share.as_slice()?;
    let (a, b) = (numbers::<4>(&a, share.len(), "a")?, numbers::<4>(&b, share.len(), "b")?);
    let out = PyArray2::zeros(py, [share.len(), 4], false);
    {
        let mut out = out.readwrite();
        let found = out.as_slice_mut()?;
        for (((found, a), b), share) in found.chunks_exact_mut(4).zip(a).zip(b).zip(share) {
            found.copy_from_slice(&one_arc(*a, *b, *share));
        }
    }
    Ok(out)
}

/// Filters the poses of many sensors; see `retarget/_solver.pyi`.
#[pyclass(name = "PoseFilter", module = "retarget._solver")]
pub struct PyPoseFilter {
    poses: Vec<SmoothPose>,
    position: Option<Cutoffs>,
    orientation: Option<Cutoffs>,
}

fn cutoffs(values: Option<(f64, f64, f64)>) -> PyResult<Option<Cutoffs>> {
    let Some((least, per_speed, of_speed)) = values else { return Ok(None) };
    if ![least, per_speed, of_speed].iter().all(|v| v.is_finite()) || least <= 0.0 || per_speed < 0.0 || of_speed <= 0.0
    {
        return Err(PyValueError::new_err("cutoffs of a filter are finite, positive numbers"));
    }
    Ok(Some(Cutoffs { least, per_speed, of_speed }))
}

#[pymethods]
impl PyPoseFilter {
    #[new]
    #[pyo3(signature = (count, *, position, orientation))]
    fn new(count: usize, position: Option<(f64, f64, f64)>, orientation: Option<(f64, f64, f64)>) -> PyResult<Self> {
        let (position, orientation) = (cutoffs(position)?, cutoffs(orientation)?);
        Ok(Self { poses: vec![SmoothPose::default(); count], position, orientation })
    }

    fn step<'py>(
        &mut self,
        py: Python<'py>,
        time: PyReadonlyArray1<'py, f64>,
        position: PyReadonlyArray2<'py, f64>,
        orientation: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Poses<'py>> {
        let count = self.poses.len();
        let time = time.as_slice()?;
        if time.len() != count {
            return Err(bad(format!("time has {} entries, expected {count}", time.len())));
        }
        let (places, turns) =
            (numbers::<3>(&position, count, "position")?, numbers::<4>(&orientation, count, "orientation")?);
        let (moved, turned) = (PyArray2::zeros(py, [count, 3], false), PyArray2::zeros(py, [count, 4], false));
        {
            let (mut moved, mut turned) = (moved.readwrite(), turned.readwrite());
            let (moved, turned) = (moved.as_slice_mut()?, turned.as_slice_mut()?);
            let sent = time.iter().zip(places).zip(turns);
            let answer = moved.chunks_exact_mut(3).zip(turned.chunks_exact_mut(4));
            for ((pose, ((time, place), turn)), (moved, turned)) in self.poses.iter_mut().zip(sent).zip(answer) {
                let place = self.position.map_or(*place, |cutoffs| pose.step_position(&cutoffs, *time, *place));
                let turn = self.orientation.map_or(*turn, |cutoffs| pose.step_orientation(&cutoffs, *time, *turn));
                moved.copy_from_slice(&place);
                turned.copy_from_slice(&turn);
            }
        }
        Ok((moved, turned))
    }

    fn reset(&mut self, rows: PyReadonlyArray1<'_, bool>) -> PyResult<()> {
        let rows = rows.as_slice()?;
        if rows.len() != self.poses.len() {
            return Err(bad(format!("rows has {} entries, expected {}", rows.len(), self.poses.len())));
        }
        for (pose, _) in self.poses.iter_mut().zip(rows).filter(|(_, gone)| **gone) {
            *pose = SmoothPose::default();
        }
        Ok(())
    }
}

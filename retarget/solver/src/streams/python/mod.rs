//! What Python sees of the stream filters: whole frames of all sensors, one call each. See `retarget/_solver.pyi`.

mod playout;
mod sensor_plan;
mod smooth;
mod validity;

use pyo3::prelude::*;

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<smooth::PyPoseFilter>()?;
    m.add_function(wrap_pyfunction!(smooth::along_arc, m)?)?;
    m.add_class::<playout::PyPoseRing>()?;
    m.add_class::<sensor_plan::PySensorPlan>()?;
    m.add_class::<sensor_plan::PyPoseParts>()?;
    m.add_class::<validity::PyValidity>()
}

use pyo3::prelude::*;
#[pymodule]
fn _solver(_m: &Bound<'_, PyModule>) -> PyResult<()> { Ok(()) }

//! What the definitions of types say of their messages.

use pyo3::prelude::*;

#[pyfunction]
pub fn different_field(datatype: &str, one: &str, other: &str) -> Option<(String, String)> {
    bagpipe_log::different_field(datatype, one, other).map(Into::into)
}

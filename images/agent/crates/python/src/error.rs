//! One exception class for all that can be wrong with a bag.

use pyo3::PyErr;
use pyo3::exceptions::PyValueError;

pyo3::create_exception!(
    bagpipe_bag,
    BagError,
    PyValueError,
    "A bag can't be read or written; the text names the byte offset and what was expected there."
);

/// The crate's error as Python's, with the bag's name before it where it has one.
pub fn raised(name: Option<&str>, error: &bagpipe_rosbag::BagError) -> PyErr {
    said(name, &error.to_string())
}

/// A sentence as an exception.
pub fn said(name: Option<&str>, sentence: &str) -> PyErr {
    match name {
        Some(name) => BagError::new_err(format!("{name}: {sentence}")),
        None => BagError::new_err(sentence.to_owned()),
    }
}

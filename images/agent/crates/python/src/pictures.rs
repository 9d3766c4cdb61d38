//! Camera pictures for the report.

use bagpipe_pictures::few_pixels;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// `(width, height, rows, columns, channels, pixels)` of a JPEG, of which at most `side` rows and
/// columns are kept. Raises `ValueError`, whose text says why there are none.
#[pyfunction]
pub fn jpeg_pixels<'py>(
    py: Python<'py>,
    data: &[u8],
    side: usize,
) -> PyResult<(usize, usize, usize, usize, usize, Bound<'py, PyBytes>)> {
    let found = py
        .detach(|| few_pixels(data, side))
        .map_err(|error| PyValueError::new_err(error.to_string()))?;
    let pixels = PyBytes::new(py, &found.data);
    Ok((found.width, found.height, found.rows, found.columns, found.channels, pixels))
}

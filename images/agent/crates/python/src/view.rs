//! A recording's memory under Python's buffer protocol.

// The buffer protocol hands out an address, which has no safe form.
#![allow(unsafe_code)]

use std::ffi::c_int;
use std::sync::Arc;

use bagpipe_mcap::Mcap;
use pyo3::exceptions::PyBufferError;
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::{PyMemoryView, PySequence};

use crate::memory::Opened;

/// What is shown.
#[derive(Debug)]
pub enum Part {
    /// A bag's whole file.
    File(Arc<Opened>),
    /// The uncompressed data of a bag's chunk at that place.
    Chunk(Arc<Opened>, usize),
    /// The same of MCAP, by the number that places have.
    Mcap(Arc<Mcap>, u32),
}

/// Read-only bytes that live as long as anybody looks at them.
#[pyclass(frozen)]
#[derive(Debug)]
struct Bytes(Part);

impl Bytes {
    fn get(&self) -> PyResult<&[u8]> {
        match &self.0 {
            Part::File(opened) => Ok(opened.bag.file().bytes()),
            Part::Chunk(opened, at) => match opened.bag.chunk_data(*at) {
                Some(found) => found.map_err(|error| opened.raised(&error)),
                None => Ok(&[]),
            },
            Part::Mcap(mcap, number) => Ok(mcap.chunk(*number).unwrap_or_default()),
        }
    }
}

#[pymethods]
impl Bytes {
    /// # Safety
    /// Called by Python alone, with a `Py_buffer` to fill in.
    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        if view.is_null() {
            return Err(PyBufferError::new_err("there is no buffer to fill in"));
        }
        let bytes = slf.get().get()?;
        let (address, length) = (bytes.as_ptr().cast_mut().cast(), bytes.len() as ffi::Py_ssize_t);
        // SAFETY: `view` is Python's to be filled in. The buffer is read-only, and it holds a
        // reference to `slf`, so to the recording: neither its file (a `bytes` object or a vector
        // that nobody changes) nor a chunk that was uncompressed (kept in a `OnceLock`) is
        // written to, moved or freed while the recording lives.
        let failed =
            unsafe { ffi::PyBuffer_FillInfo(view, slf.as_ptr(), address, length, 1, flags) };
        if failed == 0 { Ok(()) } else { Err(PyErr::fetch(slf.py())) }
    }
}

/// A memoryview of a part of a recording.
pub fn view(py: Python<'_>, part: Part) -> PyResult<Bound<'_, PyMemoryView>> {
    let bytes = Bound::new(py, Bytes(part))?;
    PyMemoryView::from(bytes.as_any())
}

/// The same as a sequence, of which slices can be taken.
pub fn sequence(py: Python<'_>, part: Part) -> PyResult<Py<PySequence>> {
    Ok(view(py, part)?.into_any().cast_into::<PySequence>()?.unbind())
}

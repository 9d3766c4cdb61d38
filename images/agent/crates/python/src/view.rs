//! A bag's memory under Python's buffer protocol.

// The buffer protocol hands out an address, which has no safe form.
#![allow(unsafe_code)]

use std::ffi::c_int;
use std::sync::Arc;

use pyo3::exceptions::PyBufferError;
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::{PyMemoryView, PySequence};

use crate::memory::Opened;

/// What is shown of a bag.
#[derive(Debug, Clone, Copy)]
pub enum Part {
    /// The whole file.
    File,
    /// The uncompressed data of the chunk at that place.
    Chunk(usize),
}

/// Read-only bytes that live as long as anybody looks at them.
#[pyclass(frozen)]
#[derive(Debug)]
struct Bytes {
    opened: Arc<Opened>,
    part: Part,
}

impl Bytes {
    fn get(&self) -> PyResult<&[u8]> {
        let bag = &self.opened.bag;
        match self.part {
            Part::File => Ok(bag.file().bytes()),
            Part::Chunk(at) => match bag.chunk_data(at) {
                Some(found) => found.map_err(|error| self.opened.raised(&error)),
                None => Ok(&[]),
            },
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
        // reference to `slf`, so to the bag: neither a bag's file (a `bytes` object or a vector
        // that nobody changes) nor a chunk that was uncompressed (kept in a `OnceLock`) is
        // written to, moved or freed while the bag lives.
        let failed =
            unsafe { ffi::PyBuffer_FillInfo(view, slf.as_ptr(), address, length, 1, flags) };
        if failed == 0 { Ok(()) } else { Err(PyErr::fetch(slf.py())) }
    }
}

/// A memoryview of a part of the bag.
pub fn view<'py>(
    py: Python<'py>,
    opened: &Arc<Opened>,
    part: Part,
) -> PyResult<Bound<'py, PyMemoryView>> {
    let bytes = Bound::new(py, Bytes { opened: Arc::clone(opened), part })?;
    PyMemoryView::from(bytes.as_any())
}

/// The same as a sequence, of which slices can be taken.
pub fn sequence(py: Python<'_>, opened: &Arc<Opened>, chunk: usize) -> PyResult<Py<PySequence>> {
    let view = view(py, opened, Part::Chunk(chunk))?;
    Ok(view.into_any().cast_into::<PySequence>()?.unbind())
}

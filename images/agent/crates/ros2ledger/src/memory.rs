//! The shared memory itself, and the only `unsafe` of this crate.
//!
//! It is a file without a name that is sealed against another length: who maps it can't be ended
//! by SIGBUS because somebody cut it.
#![allow(unsafe_code)]

use std::ops::Deref;
use std::os::fd::{AsFd, OwnedFd};
use std::ptr::NonNull;
use std::sync::atomic::Ordering::SeqCst;

use rustix::fs::{MemfdFlags, SealFlags};
use rustix::mm::{MapFlags, ProtFlags};

use crate::layout::{ENDPOINTS, Layout, MAGIC, PROCESSES, VERSION};

pub(crate) struct Memory {
    layout: NonNull<Layout>,
    file: OwnedFd,
}

// SAFETY: all of `Layout` is atomics, which any thread may use; the mapping stays until the drop.
unsafe impl Send for Memory {}
// SAFETY: as above.
unsafe impl Sync for Memory {}

impl Memory {
    /// An empty ledger.
    pub(crate) fn new() -> std::io::Result<Memory> {
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let file = rustix::fs::memfd_create("bagpipe-ros2-ledger", flags)?;
        rustix::fs::ftruncate(&file, size_of::<Layout>() as u64)?;
        rustix::fs::fcntl_add_seals(&file, SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL)?;
        // SAFETY: a new mapping at an address that the kernel chooses, of a file that is as long.
        let address = unsafe {
            rustix::mm::mmap(
                std::ptr::null_mut(),
                size_of::<Layout>(),
                ProtFlags::READ | ProtFlags::WRITE,
                MapFlags::SHARED,
                file.as_fd(),
                0,
            )
        }?;
        let layout = NonNull::new(address.cast()).ok_or(std::io::ErrorKind::OutOfMemory)?;
        let memory = Memory { layout, file };
        memory.header.version.store(VERSION, SeqCst);
        memory.header.processes.store(PROCESSES as u32, SeqCst);
        memory.header.endpoints.store(ENDPOINTS as u32, SeqCst);
        memory.header.magic.store(MAGIC, SeqCst);
        Ok(memory)
    }

    pub(crate) fn file(&self) -> &OwnedFd {
        &self.file
    }
}

impl Deref for Memory {
    type Target = Layout;

    fn deref(&self) -> &Layout {
        // SAFETY: mapped in `new` for as long as `self` lives, aligned to a page, as long as a
        // `Layout`, of which any bytes are valid; others write it too, and it is all atomics.
        unsafe { self.layout.as_ref() }
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        // SAFETY: mapped in `new` with this size; nobody has a reference after the drop.
        let unmapped =
            unsafe { rustix::mm::munmap(self.layout.as_ptr().cast(), size_of::<Layout>()) };
        debug_assert!(unmapped.is_ok());
    }
}

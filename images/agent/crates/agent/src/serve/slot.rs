//! One slot's process: cases one after the other.

use std::cell::RefCell;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use bagpipe_wire::fifo::{self, Readiness};
use bagpipe_wire::{Duplex, Next};
use rustix::process::{Signal, set_child_subreaper, set_parent_process_death_signal};

use crate::engine::on_disk::OnDisk;
use crate::metrics::{Reporter, SlotFigures};
use crate::serve::layout::Shared;
use crate::serve::options::ServeOptions;
use crate::serve::session::Slot;
use crate::stack::processes::Children;

/// How long the slot waits for bytes before it looks around.
pub(crate) const GLANCE: Duration = Duration::from_millis(500);

/// Serves one slot until SIGTERM.
pub fn run(options: &ServeOptions, number: u32, port: u16) -> Result<(), String> {
    let stop = stop_flag()?;
    become_reaper()?;
    // Without serve there is nobody to start this slot again.
    set_parent_process_death_signal(Some(Signal::TERM)).map_err(|error| error.to_string())?;
    let folder = Shared::new(&options.shared).slot(number);
    let figures = Arc::new(SlotFigures::default());
    let reporter = options.metrics.map(|_| Reporter::start(&figures)).transpose();
    let _reporter =
        reporter.map_err(|error| format!("figures cannot be reported to serve: {error}"))?;
    let slot = Slot {
        number,
        port,
        memory_budget: options.memory_budget,
        on_disk: options.on_disk.as_ref().map(|folder| OnDisk::new(folder, number, options.cold)),
        folder,
        stop: &stop,
        figures,
        children: RefCell::new(Children::default()),
    };
    let path = slot.folder.requests();
    let fail = |error: std::io::Error| format!("{}: {error}", path.display());
    let mut pipe = fifo::open_reader(&path).map_err(fail)?;
    slot.folder.note_listening()?;
    while !stop.load(Ordering::Relaxed) {
        let done = match fifo::await_bytes(&pipe, GLANCE).map_err(fail)? {
            Readiness::Nothing => continue,
            Readiness::HangUp => pipe,
            Readiness::Bytes => sessions(&slot, pipe)?,
        };
        // Before the old end is closed: a writer that is there already never gets EPIPE.
        pipe = fifo::open_reader(&path).map_err(fail)?;
        drop(done);
    }
    slot.children.borrow_mut().kill(&[]).map(|_| ())
}

/// Runs sessions while the next one is there already.
fn sessions(slot: &Slot<'_>, pipe: OwnedFd) -> Result<OwnedFd, String> {
    let pipe_bytes = fifo::grow(&pipe);
    let mut link = Duplex::new(pipe);
    loop {
        match slot.session(link, pipe_bytes)? {
            Next::Session(next) => link = next,
            Next::Reopen(pipe) => return Ok(pipe),
        }
    }
}

/// Set by SIGTERM and SIGINT.
pub fn stop_flag() -> Result<Arc<AtomicBool>, String> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(|error| format!("cannot listen to signal {signal}: {error}"))?;
    }
    Ok(stop)
}

/// Makes every orphan below this process its child.
pub fn become_reaper() -> Result<(), String> {
    let own = rustix::process::getpid();
    set_child_subreaper(Some(own)).map_err(|error| format!("PR_SET_CHILD_SUBREAPER: {error}"))
}

//! What an engine is: its name, and how it runs a case.

use std::cell::RefCell;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use bagpipe_replay::{Ledger, Meter};
use bagpipe_wire::{Duplex, to_map};
use rmpv::Value;

use crate::case::Case;
use crate::case::failure::Failure;
use crate::engine::on_disk::OnDisk;
use crate::stack::processes::Children;

/// What each folder of an engine has, in its module `entry`.
pub struct Engine {
    /// As HELLO names it.
    pub name: &'static str,
    /// Runs a case; when it returns, nothing that it started is left.
    pub run: fn(&Task<'_>) -> Result<Answer, Failure>,
}

/// A case, with what its slot has for it.
pub struct Task<'a> {
    pub case: &'a Case,
    /// The case's map as it came, for who hands it on.
    pub described: Value,
    /// The worker's.
    pub session: &'a str,
    pub link: &'a RefCell<Duplex>,
    pub deadline: Instant,
    pub stop: &'a AtomicBool,
    pub slot: u32,
    pub port: u16,
    pub memory_budget: u64,
    pub on_disk: Option<&'a OnDisk>,
    /// The slot's own, on the shared volume.
    pub folder: &'a Path,
    pub meter: &'a Arc<Meter>,
    pub children: &'a RefCell<Children>,
}

impl Task<'_> {
    /// What goes before each line of output.
    pub fn label(&self) -> String {
        format!("slot {} case {}", self.slot, self.case.id)
    }

    pub fn stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// What the worker is sent when the case has ended: RESULT, and the recording after it.
pub struct Answer {
    /// RESULT's payload.
    pub result: Vec<u8>,
    /// None where files went out as they came.
    pub recording: Option<Recording>,
    /// What the slot's figures count.
    pub ledger: Option<Ledger>,
}

impl Answer {
    /// The answer with this map alone.
    pub fn of(result: &impl serde::Serialize) -> Result<Self, Failure> {
        let result = to_map(result).map_err(|error| Failure::new("Internal", error.to_string()))?;
        Ok(Self { result, recording: None, ledger: None })
    }
}

/// A finished recording.
pub enum Recording {
    InMemory(Vec<u8>),
    /// With its length.
    OnDisk(File, u64),
}

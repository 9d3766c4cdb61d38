//! GET /metrics: what the slots of this container do and have done, for Prometheus.
//!
//! Each slot is a process of its own. It counts in plain atomics ([`SlotFigures`]) and tells
//! them `serve` over a socket, which is its stdin, four times a second while a case runs and
//! after each case ([`Teller`]). `serve` adds them up ([`Gathered`]), also those of processes
//! that have ended, and writes the page when somebody asks. Nothing waits for anything of this.

mod figures;
mod gathered;
mod teller;
mod text;

use std::net::SocketAddr;
use std::process::Stdio;
use std::sync::Arc;

use bagpipe_ros1::{Page, Pages};

pub use figures::SlotFigures;
use gathered::Gathered;
pub use teller::Teller;

/// Prometheus' text format, which `promtool` reads too.
const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

/// The endpoint, until it is dropped.
pub struct Metrics {
    gathered: Arc<Gathered>,
    _pages: Pages,
}

impl Metrics {
    /// Listens on `address`; `None`, with a sentence, if it can't be had: cases matter more.
    pub fn start(address: SocketAddr, slots: u32) -> Option<Metrics> {
        let gathered = Arc::new(Gathered::new(slots));
        let asked = Arc::clone(&gathered);
        let pages = Pages::serve("metrics", address, move |path| {
            (path == "/metrics").then(|| {
                asked.take_in();
                Page { content_type: CONTENT_TYPE, text: text::page(&asked.total()) }
            })
        });
        match pages {
            Ok(pages) => Some(Metrics { gathered, _pages: pages }),
            Err(error) => {
                eprintln!("bagpipe-agent: there will be no metrics: {error}");
                None
            }
        }
    }

    /// What the stdin of a slot's new process has to be.
    ///
    /// # Errors
    /// There are no more descriptors.
    pub fn listen_to(&self, slot: u32) -> std::io::Result<Stdio> {
        self.gathered.listen_to(slot).map(Stdio::from)
    }

    /// Takes in what the slots have told.
    pub fn take_in(&self) {
        self.gathered.take_in();
    }

    /// A slot's process has ended unasked.
    pub fn ended(&self, slot: u32) {
        self.gathered.ended(slot);
    }
}

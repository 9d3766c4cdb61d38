//! The agent's first process: makes the pipes, keeps one process for each slot running,
//! reaps, and ends everything on SIGTERM.

pub(crate) mod layout;
pub(crate) mod options;
pub(crate) mod session;
pub(crate) mod slot;
pub(crate) mod watchdog;

use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal};

use crate::case::folder::CaseFolder;
use crate::metrics::Metrics;
use crate::serve::layout::Shared;
use crate::serve::options::ServeOptions;
use crate::serve::slot::{become_reaper, stop_flag};
use crate::stack::processes::{Children, Ended, pause, signal};

/// How often the slots are looked at.
const GLANCE: Duration = Duration::from_millis(50);
/// A slot that lived so long starts again at once.
const HEALTHY: Duration = Duration::from_secs(60);
/// The longest wait before a slot that keeps dying starts again.
const LONGEST_WAIT: Duration = Duration::from_secs(10);

/// Serves until SIGTERM.
pub fn serve(options: &ServeOptions) -> Result<(), String> {
    if options.slots > u32::from(u16::MAX - options.master_port) {
        return Err(format!(
            "--master-port {} leaves no port for {} slots",
            options.master_port, options.slots
        ));
    }
    let stop = stop_flag()?;
    become_reaper()?;
    Shared::new(&options.shared).make(options.slots)?;
    let mut children = Children::default();
    let metrics = options.metrics.and_then(|address| Metrics::start(address, options.slots));
    let mut keepers: Vec<Keeper> = (0..options.slots).map(Keeper::new).collect();
    while !stop.load(Ordering::Relaxed) {
        let mut died = Vec::new();
        for keeper in &mut keepers {
            let ended = keeper.look(options, &mut children, metrics.as_ref())?;
            died.extend(ended.map(|pid| (keeper.slot, pid)));
        }
        metrics.iter().for_each(Metrics::take_in);
        if !died.is_empty() {
            end_orphans(&keepers, &mut children)?;
            remove_folders(&died, &options.shared);
        }
        pause(GLANCE);
    }
    end(&keepers, &mut children, Duration::from_millis(options.patience_ms))
}

/// Keeps one slot's process running.
struct Keeper {
    slot: u32,
    process: Option<(Pid, Instant)>,
    deaths: u32,
    again: Instant,
}

impl Keeper {
    fn new(slot: u32) -> Self {
        Self { slot, process: None, deaths: 0, again: Instant::now() }
    }

    /// Starts the process if it is time to; returns the one that has ended.
    fn look(
        &mut self,
        options: &ServeOptions,
        children: &mut Children,
        metrics: Option<&Metrics>,
    ) -> Result<Option<Pid>, String> {
        let Some((pid, since)) = self.process else {
            if Instant::now() >= self.again {
                let pid = start(self.slot, options, metrics)?;
                children.watch(pid);
                self.process = Some((pid, Instant::now()));
            }
            return Ok(None);
        };
        match children.ended(pid) {
            None => Ok(None),
            Some(ended) => {
                self.note_death(ended, since);
                metrics.iter().for_each(|metrics| metrics.ended(self.slot));
                Ok(Some(pid))
            }
        }
    }

    fn note_death(&mut self, ended: Ended, since: Instant) {
        self.process = None;
        self.deaths = if since.elapsed() >= HEALTHY { 0 } else { self.deaths + 1 };
        let wait = (Duration::from_millis(50) * 2u32.pow(self.deaths.min(10))).min(LONGEST_WAIT);
        self.again = Instant::now() + wait;
        eprintln!("bagpipe-agent: slot {} ended with {ended}; again in {wait:?}", self.slot);
    }
}

fn start(slot: u32, options: &ServeOptions, metrics: Option<&Metrics>) -> Result<Pid, String> {
    let refused = |error| format!("slot {slot} cannot be started: {error}");
    // serve() checked that the port exists.
    let port = options.master_port + slot as u16;
    let mut command = Command::new("/proc/self/exe");
    command
        .arg0("bagpipe-agent")
        .arg("slot")
        .args(["--slot", &slot.to_string(), "--port", &port.to_string()])
        .args(["--memory-budget", &options.memory_budget.to_string()])
        .arg("--shared")
        .arg(&options.shared);
    if let Some(folder) = &options.on_disk {
        command.arg("--on-disk").arg(folder).args(options.cold.then_some("--cold"));
    }
    if let (Some(metrics), Some(address)) = (metrics, options.metrics) {
        // It reports its figures on its stdin.
        command.args(["--metrics", &address.to_string()]);
        command.stdin(metrics.listen_to(slot).map_err(refused)?);
    } else {
        command.stdin(Stdio::null());
    }
    let child = command.spawn().map_err(refused)?;
    Ok(Pid::from_child(&child))
}

/// Kills what a slot that died left behind: it is our child by now.
fn end_orphans(keepers: &[Keeper], children: &mut Children) -> Result<(), String> {
    let slots: Vec<Pid> =
        keepers.iter().filter_map(|keeper| keeper.process).map(|(pid, _)| pid).collect();
    let killed = children.kill(&slots)?;
    if killed > 0 {
        eprintln!("bagpipe-agent: {killed} processes that it had started were killed");
    }
    Ok(())
}

/// Nothing of theirs runs any more that could write into the folders.
fn remove_folders(died: &[(u32, Pid)], shared: &Path) {
    for (slot, pid) in died {
        let folder = Shared::new(shared).slot(*slot);
        CaseFolder::remove_left(*slot, pid.as_raw_nonzero().get().unsigned_abs(), folder.path());
    }
}

/// Ends all slots; those that are not over after `patience`, and all that they started, are killed.
fn end(keepers: &[Keeper], children: &mut Children, patience: Duration) -> Result<(), String> {
    let begun = Instant::now();
    for (pid, _) in keepers.iter().filter_map(|keeper| keeper.process) {
        signal(pid.as_raw_nonzero().get(), Signal::TERM);
    }
    while children.reap() && begun.elapsed() < patience {
        pause(Duration::from_millis(5));
    }
    match children.kill(&[])? {
        0 => Ok(()),
        killed => Err(format!("{killed} processes had to be killed after {patience:?}")),
    }
}

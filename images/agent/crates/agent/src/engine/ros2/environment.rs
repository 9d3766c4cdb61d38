//! The environment of the stack's nodes, in which ROS 2 is set up: whatever the command sources, a
//! node's process has it.

use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use bagpipe_replay::Cancellation;
use bagpipe_ros2ledger::{Ledger, Strength};

use crate::case::failure::Failure;
use crate::engine::nodes::host::Occasion;
use crate::engine::nodes::runner::silent;
use crate::stack::processes::{descendants, pause};

/// How often a node is looked for.
const GLANCE: Duration = Duration::from_millis(5);
/// After this time a process counts that uses ROS 2 and does not report to the ledger.
const UNCOUNTED: Duration = Duration::from_secs(1);

/// Variables of a process.
pub type Variables = Vec<(OsString, OsString)>;

/// Who is the first to be there.
pub enum First {
    /// A node with these variables.
    Node(Variables),
    /// Somebody who uses no ROS 2 that can be seen from outside.
    Stranger,
    /// Nobody by the deadline.
    Nobody,
}

/// Waits for the first node of the stack. Where none has come for a while, `sees_a_stranger` is
/// asked now and then.
pub fn await_first(
    ledger: &Ledger,
    occasion: &Occasion<'_>,
    sees_a_stranger: &mut dyn FnMut() -> bool,
) -> Result<First, Failure> {
    let begun = Instant::now();
    loop {
        match (occasion.interrupted)() {
            Some(Cancellation::StackExited) => {
                let why = "the stack ended before any of its nodes was there; it must keep \
                           running until the agent stops it";
                return Err(Failure::new("StackExited", why));
            }
            Some(why) => return Err(silent(why)),
            None => {}
        }
        let counting =
            ledger.processes().map_err(|error| Failure::new("Ros2Failed", error.to_string()))?;
        let counting = counting.iter().filter(|process| process.alive).map(|one| one.id.pid);
        let late = begun.elapsed() >= UNCOUNTED;
        let uncounted = || late.then(|| uncounted(ledger)).flatten();
        let found = of_the_first(counting);
        if let Some(found) = found.or_else(|| uncounted().and_then(variables_of)) {
            return Ok(First::Node(found));
        }
        if late && sees_a_stranger() {
            return Ok(First::Stranger);
        }
        if Instant::now() >= occasion.deadline {
            return Ok(First::Nobody);
        }
        pause(GLANCE);
    }
}

/// A process below this one that uses ROS 2 and does not count.
fn uncounted(ledger: &Ledger) -> Option<u32> {
    let mut all =
        descendants(std::process::id(), &[]).into_iter().filter_map(|pid| u32::try_from(pid).ok());
    all.find(|pid| matches!(ledger.strength_of(*pid), Ok(Some(Strength::Received))))
}

/// Those of the first that has any: another user's process can't be read.
fn of_the_first(mut processes: impl Iterator<Item = u32>) -> Option<Variables> {
    processes.find_map(variables_of)
}

/// The variables that a process was started with; `None` if it is gone.
fn variables_of(pid: u32) -> Option<Variables> {
    let bytes = std::fs::read(format!("/proc/{pid}/environ")).ok()?;
    Some(parse(&bytes))
}

fn parse(bytes: &[u8]) -> Variables {
    let all = bytes.split(|byte| *byte == 0).filter_map(|variable| {
        let at = variable.iter().position(|byte| *byte == b'=').filter(|at| *at > 0)?;
        let name = OsString::from_vec(variable[..at].to_vec());
        Some((name, OsString::from_vec(variable[at + 1..].to_vec())))
    });
    all.collect()
}

/// The folders where packages are installed.
pub fn prefixes(variables: &Variables) -> Vec<PathBuf> {
    let named = |(name, _): &&(OsString, OsString)| name == "AMENT_PREFIX_PATH";
    let found = variables.iter().find(named).map(|(_, value)| value.clone());
    let folders = found.or_else(|| std::env::var_os("AMENT_PREFIX_PATH")).unwrap_or_default();
    let folders = folders.as_bytes().split(|byte| *byte == b':').filter(|one| !one.is_empty());
    folders.map(|folder| PathBuf::from(OsStr::from_bytes(folder))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_cannot_be_read_keeps_none_waiting() {
        assert!(of_the_first([u32::MAX, std::process::id()].into_iter()).is_some());
        assert!(of_the_first([u32::MAX].into_iter()).is_none());
    }

    #[test]
    fn variables_are_read() {
        let bytes = b"A=b=c\0=odd\0none\0AMENT_PREFIX_PATH=/ws::/opt/ros\0E=\0";
        let found = parse(bytes);
        let names: Vec<&str> = found.iter().filter_map(|(name, _)| name.to_str()).collect();
        assert_eq!(names, ["A", "AMENT_PREFIX_PATH", "E"]);
        assert_eq!(found[0].1, "b=c");
        assert_eq!(prefixes(&found), [PathBuf::from("/ws"), PathBuf::from("/opt/ros")]);
        assert_eq!(parse(b""), []);
    }
}

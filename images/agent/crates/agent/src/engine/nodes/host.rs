//! What a middleware has around the nodes of one case.

use std::sync::Arc;
use std::time::Instant;

use bagpipe_graph::Middleware;
use bagpipe_log::RecordingFormat;
use bagpipe_replay::Cancellation;
use bagpipe_wire::Abort;
use rustix::process::Pid;

use crate::case::failure::Failure;
use crate::stack::end::StackEnd;
use crate::stack::exit_code::Exit;
use crate::stack::nodes::{Found, Known};
use crate::stack::processes::{Children, Ended};
use crate::stack::witness::Watcher;
use crate::stack::{Program, Surroundings, Variables};

/// What a host is given for a call that may take its time.
pub struct Occasion<'a> {
    pub surroundings: &'a Surroundings<'a>,
    pub children: &'a std::cell::RefCell<Children>,
    /// Until when it must be done.
    pub deadline: Instant,
    /// Whether the case must end.
    pub interrupted: &'a dyn Fn() -> Option<Cancellation>,
}

/// What plays, where there is a choice.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ChosenPlayer {
    pub name: PlayerName,
    /// A sentence's end.
    pub why: String,
}

/// By the image's librcl, or on DDS alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PlayerName {
    Rcl,
    Dds,
}

impl std::fmt::Display for PlayerName {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(match self {
            PlayerName::Rcl => "librcl",
            PlayerName::Dds => "DDS alone",
        })
    }
}

/// A middleware, for one case.
pub trait Host {
    /// What the stack finds in its environment.
    fn variables(&self) -> Variables;

    /// The stack's command as it is started.
    fn command(&self) -> Result<Vec<String>, Failure>;

    /// Starts what nodes need to find each other, and waits until it answers.
    fn start(&self, occasion: &Occasion<'_>) -> Result<(), Failure>;

    /// Takes in who watches how the stack's processes end: a node's may end before it is found.
    fn watch_by(&self, _watcher: Watcher) {}

    /// Once the stack was started: how to join its graph.
    fn meet(&self, occasion: &Occasion<'_>) -> Result<Arc<dyn Middleware>, Failure>;

    /// Processes of its own by now, which are none of the stack's.
    fn processes(&self) -> Vec<Pid>;

    /// What plays, by now.
    fn chosen_player(&self) -> Option<ChosenPlayer> {
        None
    }

    /// How the recording is written.
    fn record_as(&self) -> Arc<dyn RecordingFormat>;

    /// Whether the stack runs on simulated time.
    fn use_sim_time(&self) -> bool;

    /// All nodes but our own and those that people start by hand, which may end as they like. Fails, as the next two do, where it is not known.
    fn roll(&self) -> Result<Vec<Known>, Failure>;

    /// Nodes that were ever there by now, with their processes, also those that have left since; asked once. As in
    /// the roll.
    fn met(&self) -> Vec<Known>;

    /// Notes who is still there when all input is out: who leaves after that is done.
    fn note_stayed(&self, roll: &mut [Known]) -> Result<(), Failure>;

    /// What has become of each.
    fn look(&self, roll: &[Known]) -> Result<Vec<Found>, Failure>;

    /// What nodes' processes have noted themselves of their ends by now. Fails where that can't be read.
    fn exits(&self) -> Result<Vec<Exit>, Failure> {
        Ok(Vec::new())
    }

    /// How the program ended by itself that nodes need to find each other, if it has.
    fn ended(&self, _children: &mut Children) -> Option<Ended> {
        None
    }

    /// That program, once everything was ended, for its last lines.
    fn take_program(&self) -> Option<Program> {
        None
    }

    /// Why a case is worth nothing whose program ended by itself.
    fn gone(&self, ending: Ending) -> Abort {
        Abort { reason: "Internal".to_owned(), stderr: ending.stderr, ..Abort::default() }
    }

    /// Adds to a fault of the case what the programs wrote and how they ended.
    fn explain(&self, abort: Abort, stack: Option<StackEnd>, _ending: Ending) -> Abort {
        match stack {
            Some(stack) => stack.explain(abort),
            None => abort,
        }
    }
}

/// How a host's program ended before it was ended.
#[derive(Default)]
pub struct Ending {
    pub ended: Option<Ended>,
    pub stderr: Vec<String>,
}

//! RESULT: what came of a case.

use bagpipe_replay::{Ledger, Machine, Playback, Recorded, Replayed};
use serde::{Deserialize, Serialize};

use crate::engine::nodes::host::ChosenPlayer;
use crate::stack::end::StackEnd;
use crate::stack::evidence::warnings;

/// The map of RESULT: bagpipe/engine/replay_result.py, with which tests compare it.
#[derive(Debug, Serialize, Deserialize)]
pub struct Outcome {
    pub stack: StackEnd,
    pub ledger: Ledger,
    pub recorded: Recorded,
    pub playback: Playback,
    pub timings: Timings,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub machine: Option<Machine>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub player: Option<ChosenPlayer>,
}

/// Seconds of each part of the case.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct Timings {
    pub assemble: f64,
    pub master: f64,
    pub stack: f64,
    pub subscribe: f64,
    pub lead_in: f64,
    pub play: f64,
    pub drain: f64,
    pub stop: f64,
}

impl Outcome {
    /// Joins what the player knows with what the supervisor knows.
    pub fn new(
        replayed: Replayed,
        stack: StackEnd,
        mut timings: Timings,
        player: Option<ChosenPlayer>,
    ) -> (Self, Vec<u8>) {
        let mut replayed = replayed;
        replayed.playback.warnings.extend(warnings(&stack.after));
        let Replayed { ledger, recorded, playback, timings: played, machine, recorded_bag } =
            replayed;
        timings.subscribe = played.subscribe;
        timings.lead_in = played.lead_in;
        timings.play = played.play;
        timings.drain = played.drain;
        (Self { stack, ledger, recorded, playback, timings, machine, player }, recorded_bag)
    }
}

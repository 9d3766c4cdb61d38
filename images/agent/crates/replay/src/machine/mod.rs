//! The machine while a window is played: could it have caused a loss?

mod busy;
mod gauge;
mod kernel;

pub(crate) use gauge::{Foreign, Gauge};

use serde::{Deserialize, Serialize};

/// How the machine was during play and drain. What it does not report is `None`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// How much later than due the latest message left; 0 where none has a time to leave.
    pub late_max_seconds: f64,
    /// The most that a thread that wanted to wake every 10 ms woke later than that.
    pub stall_max_seconds: f64,
    /// How long some task of our cgroup (else of the machine) waited for a processor.
    pub cpu_pressure_seconds: Option<f64>,
    /// How long our cgroup was kept from the processors by its limit.
    pub throttled_seconds: Option<f64>,
    /// What the hypervisor gave to others, summed over our processors.
    pub steal_seconds: Option<f64>,
    /// Whether the machine could have caused a loss.
    pub busy: bool,
    /// Why, or why not, as a sentence.
    pub message: String,
}

//! The page, in Prometheus' text format
//! (<https://prometheus.io/docs/instrumenting/exposition_formats/>).
//!
//! Written here and not by a client library: the figures come from other processes as sums, so
//! a library's counters would stand unused, and prometheus-client writes OpenMetrics only, which
//! `promtool check metrics` does not judge.

use std::fmt::{Display, Write};

use bagpipe_replay::WAIT_BOUNDS;

use super::gathered::Total;

/// The whole page. Every series is there from the beginning.
pub fn page(total: &Total) -> String {
    let mut text = Text::default();
    slots(&mut text, total);
    cases(&mut text, total);
    replays(&mut text, total);
    recordings(&mut text, total);
    lockstep(&mut text, total);
    text.0
}

fn slots(text: &mut Text, total: &Total) {
    let version = ("version", env!("CARGO_PKG_VERSION"));
    text.family("info", Kind::Gauge, "1; the label tells the agent's release.");
    text.sample("info", Some(version), 1);
    text.one("slots", Kind::Gauge, "Places for cases in this container.", total.slots);
    text.one("slots_busy", Kind::Gauge, "Places in which a case runs.", total.busy);
    text.one(
        "slot_deaths_total",
        Kind::Counter,
        "Processes of slots that ended although nobody had asked them to; each is started anew.",
        total.deaths,
    );
}

fn cases(text: &mut Text, total: &Total) {
    let figures = &total.figures;
    text.family(
        "cases_ended_total",
        Kind::Counter,
        "Runs of cases by their end: answered with a result, aborted with a reason, abandoned \
         because the worker had left or the slot's process died.",
    );
    for (outcome, count) in [
        ("answered", figures.answered),
        ("aborted", figures.aborted),
        ("abandoned", figures.abandoned),
    ] {
        text.sample("cases_ended_total", Some(("outcome", outcome)), count);
    }
    text.one(
        "fragment_received_bytes_total",
        Kind::Counter,
        "Bytes of fragments and files that came through the pipes.",
        figures.received_bytes,
    );
    text.one(
        "pipe_size_bytes",
        Kind::Gauge,
        "Size of the slots' smallest pipe as the kernel gave it: 256 KiB were asked for; 0 before \
         the first case.",
        figures.pipe_bytes,
    );
    text.family(
        "ledger_messages_total",
        Kind::Counter,
        "The ledgers' sums over all runs with a result, in messages; what was dropped was lost on \
         its way to a subscriber.",
    );
    for (counted, count) in ["sent", "received", "dropped"].into_iter().zip(figures.ledger) {
        text.sample("ledger_messages_total", Some(("counted", counted)), count);
    }
}

fn replays(text: &mut Text, total: &Total) {
    let replay = &total.figures.replay;
    text.one(
        "played_messages_total",
        Kind::Counter,
        "Messages that were played, warm-ups included.",
        replay.played_messages,
    );
    text.one(
        "replay_bag_seconds_total",
        Kind::Counter,
        "Time of recordings that was played in the mode realtime.",
        seconds(replay.realtime_nanoseconds),
    );
    text.one(
        "replay_due_seconds_total",
        Kind::Counter,
        "Time of recordings that should have been played meanwhile, at the rate that was asked for.",
        seconds(replay.due_nanoseconds),
    );
    text.one(
        "replay_unpaced_bag_seconds_total",
        Kind::Counter,
        "Time of recordings, or of a simulator, that was played in the modes max and lockstep.",
        seconds(replay.unpaced_nanoseconds),
    );
}

fn recordings(text: &mut Text, total: &Total) {
    let replay = &total.figures.replay;
    text.one(
        "recorded_messages_total",
        Kind::Counter,
        "Recorded messages.",
        replay.recorded_messages,
    );
    text.one(
        "recorded_bytes_total",
        Kind::Counter,
        "Bytes of recorded messages.",
        replay.recorded_bytes,
    );
    text.one(
        "recordings_size_bytes",
        Kind::Gauge,
        "Bytes of the recordings that are being made.",
        replay.held_bytes,
    );
    text.one(
        "recorder_high_water_bytes",
        Kind::Gauge,
        "The most that a recording has held since the agent's start; it may hold 1 GiB.",
        replay.high_water_bytes,
    );
}

fn lockstep(text: &mut Text, total: &Total) {
    const WAIT: &str = "lockstep_wait_seconds";
    let replay = &total.figures.replay;
    text.family(
        WAIT,
        Kind::Histogram,
        "Time from inputs' release to the stack's answer, of each answer that came in time.",
    );
    let mut count = 0;
    for (place, waits) in replay.waits.iter().enumerate() {
        count += waits;
        let bound = WAIT_BOUNDS.get(place).map_or("+Inf".to_owned(), f64::to_string);
        text.sample(&format!("{WAIT}_bucket"), Some(("le", &bound)), count);
    }
    text.sample(&format!("{WAIT}_sum"), None, seconds(replay.waited_nanoseconds));
    text.sample(&format!("{WAIT}_count"), None, count);
    text.one(
        "lockstep_unanswered_total",
        Kind::Counter,
        "Answers that lock-step waited for and that did not come in time.",
        replay.unanswered,
    );
}

/// What a family's samples mean.
#[derive(Clone, Copy)]
enum Kind {
    Counter,
    Gauge,
    Histogram,
}

/// The page so far. Names are given without their common beginning.
#[derive(Default)]
struct Text(String);

impl Text {
    /// What precedes a family's samples.
    fn family(&mut self, name: &str, kind: Kind, help: &str) {
        let kind = match kind {
            Kind::Counter => "counter",
            Kind::Gauge => "gauge",
            Kind::Histogram => "histogram",
        };
        self.line(format_args!("# HELP bagpipe_agent_{name} {help}"));
        self.line(format_args!("# TYPE bagpipe_agent_{name} {kind}"));
    }

    /// A figure of a family; labels are words of ours, which need no quoting.
    fn sample(&mut self, name: &str, label: Option<(&str, &str)>, value: impl Display) {
        match label {
            Some((key, word)) => {
                self.line(format_args!("bagpipe_agent_{name}{{{key}=\"{word}\"}} {value}"));
            }
            None => self.line(format_args!("bagpipe_agent_{name} {value}")),
        }
    }

    /// A family of one figure.
    fn one(&mut self, name: &str, kind: Kind, help: &str, value: impl Display) {
        self.family(name, kind, help);
        self.sample(name, None, value);
    }

    fn line(&mut self, line: impl Display) {
        // Writing into a String can't fail.
        let _written = writeln!(self.0, "{line}");
    }
}

fn seconds(nanoseconds: u64) -> f64 {
    nanoseconds as f64 / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_are_written_as_prometheus_adds_them_up() {
        let mut total = Total::default();
        total.figures.replay.waits = [1, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1];
        total.figures.replay.waited_nanoseconds = 12_500_000_001;
        total.figures.ledger = [7, 6, 1];
        let page = page(&total);
        for line in [
            "bagpipe_agent_lockstep_wait_seconds_bucket{le=\"0.0005\"} 1",
            "bagpipe_agent_lockstep_wait_seconds_bucket{le=\"0.0025\"} 3",
            "bagpipe_agent_lockstep_wait_seconds_bucket{le=\"2.5\"} 3",
            "bagpipe_agent_lockstep_wait_seconds_bucket{le=\"10\"} 4",
            "bagpipe_agent_lockstep_wait_seconds_bucket{le=\"+Inf\"} 5",
            "bagpipe_agent_lockstep_wait_seconds_sum 12.500000001",
            "bagpipe_agent_lockstep_wait_seconds_count 5",
            "bagpipe_agent_ledger_messages_total{counted=\"dropped\"} 1",
        ] {
            assert!(page.lines().any(|found| found == line), "{line}\n{page}");
        }
    }
}

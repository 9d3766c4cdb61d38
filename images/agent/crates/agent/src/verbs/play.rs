//! `play`: bags into any ROS 1 graph.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_log::Recording;
use bagpipe_replay::{
    AnswerBy, Cancellation, Mode, Pause, Progress, ReplayError, ReplayRequest, Replayed, Resumed,
    StartWhen, Step, Window, replay_together,
};
use bagpipe_rosbag::{Compression, WriterOptions};
use clap::Args;

use crate::formats::{self, Opened};
use crate::verbs::bagfile::{Memory, loss, refused, write};
use crate::verbs::delivery_table::table;
use crate::verbs::graph_options::{graph, interrupted, positive, seconds};
use crate::verbs::record::of_part;

/// What a case may take when nobody says how long: a month.
const ENDLESS: Duration = Duration::from_secs(31 * 24 * 3600);

/// The options of `play`.
#[derive(Debug, Args)]
pub struct PlayOptions {
    /// Bags of format 2.0 or 1.2, or MCAP of ROS 1. Several are played as one, by the times of their
    /// messages.
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// The ROS master; without it, ROS_MASTER_URI.
    #[arg(long, value_name = "URI")]
    master: Option<String>,
    /// Bag seconds per second.
    #[arg(short, long, value_name = "FACTOR", default_value_t = 1.0, value_parser = positive)]
    rate: f64,
    /// As fast as the slowest subscriber reads; nothing is lost on the way to its node.
    #[arg(short, long, conflicts_with_all = ["rate", "step"])]
    immediate: bool,
    /// In lock-step: after a message of TRIGGER the next message waits for ANSWER, at most
    /// for SECONDS (2). Add `stamp` if the answer carries the trigger's header stamp, and
    /// `optional` if the trigger may be skipped. Steps with one answer are fused inputs.
    #[arg(long, value_name = "TRIGGER=ANSWER[,SECONDS][,stamp][,optional]", value_parser = step,
          conflicts_with = "rate")]
    step: Vec<Step>,
    /// Begin so many seconds after the bag's start; latched messages in force there are
    /// played first.
    #[arg(short, long, value_name = "SECONDS", default_value = "0", value_parser = seconds)]
    start: Duration,
    /// Play so many seconds of the bag.
    #[arg(short = 'u', long, value_name = "SECONDS", value_parser = seconds)]
    duration: Option<Duration>,
    /// Play only these topics, and wait until each has a subscriber.
    #[arg(long, value_name = "TOPIC", num_args = 1..)]
    topics: Vec<String>,
    /// Publish every topic below this name.
    #[arg(short, long, value_name = "NAME")]
    prefix: Option<String>,
    /// Publish the recorded topic OLD as NEW.
    #[arg(long, value_name = "OLD:=NEW", value_parser = renaming)]
    remap: Vec<(String, String)>,
    /// Publish /clock: in real time so many times per second of bag time (100), or with `step`
    /// only with each message, as it always is with --immediate and --step. Set /use_sim_time
    /// before the nodes start.
    #[arg(long, value_name = "HZ|step", num_args = 0..=1, default_missing_value = "100",
          value_parser = clock_rate)]
    clock: Option<f64>,
    /// Stop before each message of this (published) topic until Enter is pressed.
    #[arg(long, value_name = "TOPIC")]
    pause: Vec<String>,
    /// Wait so long after the subscribers are there.
    #[arg(short, long, value_name = "SECONDS", default_value = "0.2", value_parser = seconds)]
    delay: Duration,
    /// Wait until this node subscribes to one of the topics.
    #[arg(long, value_name = "NODE")]
    wait_for: Vec<String>,
    /// Wait until TOPIC has N subscribers.
    #[arg(long, value_name = "TOPIC=N", value_parser = count)]
    subscribers: Vec<(String, usize)>,
    /// How long to wait for all of that.
    #[arg(long, value_name = "SECONDS", default_value = "20", value_parser = seconds)]
    subscribe_timeout: Duration,
    /// How long the last messages may take, and a subscriber may read nothing.
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = seconds)]
    drain_timeout: Duration,
    /// Record the answers: topics whose whole names match this expression.
    #[arg(long, value_name = "REGEX", requires = "output")]
    record: Vec<String>,
    /// Where the recorded answers go.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Play all of it so many times, one after the other. Each round registers again and has a
    /// ledger of its own; its answers go to FILE_0.bag, FILE_1.bag and so on.
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u32).range(1..))]
    repeat: u32,
    /// Print the ledger and all figures as JSON instead of a table, a line for each round.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    memory: Memory,
}

/// Plays, round after round, and reports what was delivered in each.
///
/// # Errors
/// A sentence: something can't be read, played or written, or messages were lost.
pub fn play(options: &PlayOptions) -> Result<(), String> {
    let open = |path: &PathBuf| open(path, options.memory);
    let bags: Vec<_> = options.files.iter().map(open).collect::<Result<_, _>>()?;
    let interrupted = interrupted()?;
    let mut losses = Vec::new();
    for round in 0..options.repeat {
        let replayed = options.play_round(&bags, &interrupted).map_err(|error| {
            if options.repeat > 1 { format!("{}: {error}", options.name(round)) } else { error }
        })?;
        let output = options.output_of(round);
        if let Some(output) = &output {
            write(output, &replayed.recorded_bag)?;
        }
        options.report(round, output.as_deref(), &replayed)?;
        if replayed.ledger.dropped > 0 {
            let lost = replayed.ledger.dropped.to_string();
            let several = options.repeat > 1;
            losses.push(if several { format!("{lost} in {}", options.name(round)) } else { lost });
        }
    }
    if losses.is_empty() {
        return Ok(());
    }
    Err(format!("not every subscriber received every message: lost were {}", losses.join(", ")))
}

fn open(path: &Path, memory: Memory) -> Result<Opened, String> {
    let name = path.display();
    let bytes = std::fs::read(path).map_err(|error| format!("{name}: {error}"))?;
    let opened =
        formats::file(bytes, memory.memory_budget).map_err(|error| refused(path, &error))?;
    if let Some(lost) = &opened.loss {
        eprintln!("{name}: {}; the rest is played", loss(lost));
    }
    Ok(opened)
}

/// Goes on once a line has come on stdin, or its end.
fn enter() -> Resumed {
    let waiting: Mutex<Option<Receiver<()>>> = Mutex::new(None);
    Arc::new(move |topic| {
        let mut waiting = waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let line = waiting.get_or_insert_with(|| {
            eprintln!("paused before a message of {topic}; Enter goes on");
            let (entered, line) = channel();
            std::thread::spawn(move || {
                let mut text = String::new();
                // An end of input or an error is nobody who could ever press Enter.
                let _ended = std::io::stdin().read_line(&mut text);
                // Without a receiver the play is over.
                let _over = entered.send(());
            });
            line
        });
        let resumed = !matches!(line.try_recv(), Err(TryRecvError::Empty));
        if resumed {
            *waiting = None;
        }
        resumed
    })
}

impl PlayOptions {
    /// Everything once, with registrations of its own.
    fn play_round(&self, bags: &[Opened], interrupted: &AtomicBool) -> Result<Replayed, String> {
        let request = self.request(bags)?;
        let cancelled = || interrupted.load(Ordering::Relaxed).then_some(Cancellation::Terminated);
        let mut silent = |_: Progress| ();
        let bags: Vec<&dyn Recording> = bags.iter().map(|bag| &*bag.recording).collect();
        let played = replay_together(&bags, &request, &mut silent, &cancelled);
        played.map_err(|error| match &error {
            ReplayError::Cancelled(_) => "interrupted".to_owned(),
            ReplayError::BagUnreadable { bag, .. } => match self.files.get(*bag) {
                Some(path) => format!("{}: {error}", path.display()),
                None => error.to_string(),
            },
            _ => error.to_string(),
        })
    }

    fn name(&self, round: u32) -> String {
        format!("round {} of {}", round + 1, self.repeat)
    }

    /// Where a round's answers go.
    fn output_of(&self, round: u32) -> Option<PathBuf> {
        let output = self.output.as_ref()?;
        Some(if self.repeat > 1 { of_part(output, round) } else { output.clone() })
    }

    fn report(&self, round: u32, output: Option<&Path>, replayed: &Replayed) -> Result<(), String> {
        if self.json {
            let json = serde_json::to_string(replayed).map_err(|error| error.to_string())?;
            println!("{json}");
            return Ok(());
        }
        if self.repeat > 1 {
            let into = output.map(|path| format!(", answers in {}", path.display()));
            println!("{}{}", self.name(round), into.unwrap_or_default());
        }
        print!("{}", table(replayed));
        Ok(())
    }

    fn request(&self, bags: &[Opened]) -> Result<ReplayRequest, String> {
        let ranges: Vec<(u64, u64)> = bags.iter().filter_map(|bag| bag.span).collect();
        let first = ranges.iter().map(|(first, _)| *first).min().unwrap_or(0);
        let last = ranges.iter().map(|(_, last)| *last).max().unwrap_or(0);
        let nanoseconds = |time: Duration| u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        let start = first.saturating_add(nanoseconds(self.start));
        let rest = last.saturating_add(1).max(start);
        let end = self.duration.map_or(rest, |time| start.saturating_add(nanoseconds(time)));
        let mode = match (self.immediate, self.step.is_empty()) {
            (true, _) => Mode::Max,
            (false, false) => Mode::Lockstep,
            (false, true) => Mode::Realtime,
        };
        Ok(ReplayRequest {
            middleware: graph(self.master.as_deref())?,
            window: Window { lead_in_start: start, start, end: end.min(rest) },
            topics: self.topics.clone(),
            late: BTreeMap::new(),
            remap: self.names(bags),
            mode,
            steps: self.step.clone(),
            rate: self.rate,
            record_topics: self.record.clone(),
            record_as: Arc::new(WriterOptions::with_compression(Compression::Lz4)),
            byte_budget: u64::MAX,
            record_to: None,
            subscribe_deadline: self.subscribe_timeout,
            drain_deadline: self.drain_timeout,
            case_deadline: Instant::now() + ENDLESS,
            use_sim_time: self.clock.is_some(),
            clock_rate: self.clock.unwrap_or(bagpipe_replay::CLOCK_RATE),
            start: StartWhen {
                nodes: self.wait_for.clone(),
                subscribers: self.subscribers.iter().cloned().collect(),
                delay: self.delay,
                ..StartWhen::default()
            },
            pause: (!self.pause.is_empty())
                .then(|| Pause { topics: self.pause.clone(), resumed: enter() }),
            meter: Arc::default(),
        })
    }

    /// The published name of each recorded topic that has another one.
    fn names(&self, bags: &[Opened]) -> BTreeMap<String, String> {
        let slash = |name: &str| format!("/{}", name.trim_matches('/'));
        let renamed: BTreeMap<String, String> =
            self.remap.iter().map(|(old, new)| (slash(old), slash(new))).collect();
        let prefix = self.prefix.as_deref().map(slash).unwrap_or_default();
        let connections = bags.iter().flat_map(|bag| bag.recording.connections());
        let recorded = connections.map(|connection| slash(&connection.topic));
        let named = recorded.map(|old| {
            let new = renamed.get(&old).unwrap_or(&old);
            (format!("{prefix}{new}"), old.clone())
        });
        named.filter(|(new, old)| new != old).collect()
    }
}

fn step(text: &str) -> Result<Step, String> {
    let mut parts = text.split(',');
    let names = parts.next().and_then(|names| names.split_once('='));
    let (trigger, answer) = names.ok_or("write it as TRIGGER=ANSWER")?;
    let mut step = Step {
        trigger: trigger.to_owned(),
        answer: answer.to_owned(),
        deadline: Duration::from_secs(2),
        by: AnswerBy::Count,
        optional: false,
    };
    for part in parts {
        match part {
            "stamp" => step.by = AnswerBy::Stamp,
            "optional" => step.optional = true,
            number => step.deadline = seconds(number)?,
        }
    }
    Ok(step)
}

fn renaming(text: &str) -> Result<(String, String), String> {
    let (old, new) = text.split_once(":=").ok_or("write it as OLD:=NEW")?;
    Ok((old.to_owned(), new.to_owned()))
}

fn clock_rate(text: &str) -> Result<f64, String> {
    if text == "step" { Ok(0.0) } else { positive(text) }
}

fn count(text: &str) -> Result<(String, usize), String> {
    let (topic, number) = text.split_once('=').ok_or("write it as TOPIC=N")?;
    let number = number.parse().map_err(|error| format!("{number:?}: {error}"))?;
    Ok((topic.to_owned(), number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_written_in_one_word() {
        let plain = step("/image=/lane").unwrap();
        assert_eq!((plain.trigger.as_str(), plain.answer.as_str()), ("/image", "/lane"));
        assert_eq!((plain.deadline, plain.by), (Duration::from_secs(2), AnswerBy::Count));
        let full = step("/image=/lane,0.5,stamp,optional").unwrap();
        assert_eq!((full.deadline, full.by), (Duration::from_millis(500), AnswerBy::Stamp));
        assert!(full.optional);
        assert!(step("/image").is_err() && step("/a=/b,soon").is_err());
    }
}

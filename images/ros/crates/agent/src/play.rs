//! `play`: a bag into any ROS 1 graph.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_bag::{Bag, ChunkedFile, MemoryChunkedFile};
use bagpipe_replay::{
    AnswerBy, Cancellation, Mode, Pause, Progress, ReplayRequest, Replayed, Resumed, StartWhen,
    Step, Window, replay,
};
use clap::Args;

use crate::graph_options::{interrupted, master_uri, positive, seconds};

/// What a case may take when nobody says how long: a month.
const ENDLESS: Duration = Duration::from_secs(31 * 24 * 3600);

/// The options of `play`.
#[derive(Debug, Args)]
pub struct PlayOptions {
    /// A bag of format 2.0. To play several as one, merge them first.
    #[arg(value_name = "FILE")]
    file: PathBuf,
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
    /// Publish /clock; with a number, so many times per second of bag time in real time.
    /// Otherwise it steps with each message. Set /use_sim_time before the nodes start.
    #[arg(long, value_name = "HZ", num_args = 0..=1, default_missing_value = "100",
          value_parser = positive)]
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
    /// Print the ledger and all figures as JSON instead of a table.
    #[arg(long)]
    json: bool,
}

/// Plays, and tells what was delivered.
pub fn play(options: &PlayOptions) -> Result<(), String> {
    let path = options.file.display();
    let bytes = std::fs::read(&options.file).map_err(|error| format!("{path}: {error}"))?;
    let bag =
        Bag::open(MemoryChunkedFile::new(bytes)).map_err(|error| format!("{path}: {error}"))?;
    let request = options.request(&bag)?;
    let interrupted = interrupted()?;
    let cancelled = || interrupted.load(Ordering::Relaxed).then_some(Cancellation::Terminated);
    let mut silent = |_: Progress| ();
    let replayed =
        replay(&bag, &request, &mut silent, &cancelled).map_err(|error| describe(&error, &path))?;
    if let Some(output) = &options.output {
        write(output, &replayed.recorded_bag)?;
    }
    if options.json {
        let json = serde_json::to_string(&replayed).map_err(|error| error.to_string())?;
        println!("{json}");
    } else {
        print!("{}", table(&replayed));
    }
    Ok(())
}

fn describe(error: &bagpipe_replay::ReplayError, path: &std::path::Display<'_>) -> String {
    match error.reason() {
        "Terminated" => "interrupted".to_owned(),
        "BagUnreadable" => format!("{path}: {error}"),
        _ => error.to_string(),
    }
}

/// Goes on once a line has come on stdin, or its end.
fn enter() -> Resumed {
    let waiting: Mutex<Option<Receiver<()>>> = Mutex::new(None);
    Arc::new(move |topic| {
        let mut waiting = waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let line = waiting.get_or_insert_with(|| {
            eprintln!("paused before a message of {topic}; Enter goes on");
            let (said, line) = channel();
            std::thread::spawn(move || {
                let mut text = String::new();
                // An end of input or an error is nobody who could ever press Enter.
                let _ended = std::io::stdin().read_line(&mut text);
                // Without a receiver the play is over.
                let _over = said.send(());
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

/// Writes a file so that it is there as a whole or not at all.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), String> {
    let mut active = path.as_os_str().to_owned();
    active.push(".active");
    std::fs::write(&active, bytes)
        .and_then(|()| std::fs::rename(&active, path))
        .map_err(|error| format!("{}: {error}", path.display()))
}

impl PlayOptions {
    fn request<F: ChunkedFile>(&self, bag: &Bag<F>) -> Result<ReplayRequest, String> {
        let (first, last) = bag.time_range().unwrap_or((0, 0));
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
            master_uri: master_uri(self.master.as_deref())?,
            window: Window { lead_in_start: start, start, end: end.min(rest) },
            topics: self.topics.clone(),
            remap: self.names(bag),
            mode,
            steps: self.step.clone(),
            rate: self.rate,
            record_topics: self.record.clone(),
            byte_budget: u64::MAX,
            subscribe_deadline: self.subscribe_timeout,
            drain_deadline: self.drain_timeout,
            case_deadline: Instant::now() + ENDLESS,
            use_sim_time: self.clock.is_some(),
            clock_rate: self.clock.unwrap_or(bagpipe_replay::CLOCK_RATE),
            start: StartWhen {
                nodes: self.wait_for.clone(),
                subscribers: self.subscribers.iter().cloned().collect(),
                delay: self.delay,
            },
            pause: (!self.pause.is_empty())
                .then(|| Pause { topics: self.pause.clone(), resumed: enter() }),
        })
    }

    /// The published name of each recorded topic that has another one.
    fn names<F: ChunkedFile>(&self, bag: &Bag<F>) -> BTreeMap<String, String> {
        let slash = |name: &str| format!("/{}", name.trim_matches('/'));
        let renamed: BTreeMap<String, String> =
            self.remap.iter().map(|(old, new)| (slash(old), slash(new))).collect();
        let prefix = self.prefix.as_deref().map(slash).unwrap_or_default();
        let recorded = bag.connections().iter().map(|connection| slash(&connection.topic));
        let named = recorded.map(|old| {
            let new = renamed.get(&old).unwrap_or(&old);
            (format!("{prefix}{new}"), old.clone())
        });
        named.filter(|(new, old)| new != old).collect()
    }
}

fn table(replayed: &Replayed) -> String {
    let ledger = &replayed.ledger;
    let mut lines = vec![format!(
        "{} messages in {:.3} s, {} received by every subscriber, {} dropped",
        ledger.sent, replayed.playback.played_seconds, ledger.received, ledger.dropped
    )];
    for topic in &ledger.topics {
        lines.push(format!("{}  {} sent", topic.topic, topic.sent));
        for line in &topic.subscribers {
            let (node, received, dropped) = (&line.node, line.received, line.dropped);
            lines.push(format!("  {node}  {received} received, {dropped} dropped"));
        }
        if topic.subscribers.is_empty() {
            lines.push("  nobody subscribed".to_owned());
        }
    }
    for step in &replayed.playback.steps {
        lines.push(format!(
            "{} -> {}  {} answered, {} without output, {} skipped",
            step.triggers.join(" + "),
            step.answer,
            step.answered,
            step.no_output,
            step.skipped
        ));
    }
    lines.extend(replayed.playback.warnings.iter().cloned());
    lines.join("\n") + "\n"
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

//! `slice`: a part of a recording as a recording.

use std::path::PathBuf;

use bagpipe_formats::Kind;
use bagpipe_log::{Connection, Window};
use clap::Args;

use crate::verbs::bagfile::{Memory, Output, failed, kind, unreadable};

#[derive(Debug, Args)]
#[command(after_help = "Times are seconds after the bag's first message, such as 12.5; messages\n\
    with start <= t < end are taken. A latched message from before (/tf_static, a map) goes\n\
    with the slice, at its start, because a subscriber that joined then would have got it.\n\
    A bag's chunks that lie in the window as a whole are copied as they are. Of all other\n\
    recordings the slice is MCAP, without attachments and metadata, which are about the whole.\n\n\
    Example: bagpipe-agent slice drive.bag --start 60 --end 80 --topic /imu --output part.bag")]
pub struct Options {
    /// A bag of format 2.0 or 1.2, MCAP, a file of SQLite of rosbag2, or a folder of rosbag2.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Where the slice starts; without it, at the first message.
    #[arg(long, value_name = "SECONDS", value_parser = nanoseconds)]
    start: Option<u64>,
    /// Where it ends; without it, behind the last message.
    #[arg(long, value_name = "SECONDS", value_parser = nanoseconds)]
    end: Option<u64>,
    /// Only this topic; may be given several times.
    #[arg(long = "topic", value_name = "NAME")]
    topics: Vec<String>,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    memory: Memory,
}

impl Options {
    /// The window that is asked for, of a recording whose messages have these times.
    fn window(&self, times: Option<(u64, u64)>) -> Result<Window, String> {
        let first = times.map_or(0, |(first, _)| first);
        let at = |offset: Option<u64>| offset.map(|offset| first.saturating_add(offset));
        let start = at(self.start).unwrap_or(0);
        let window = Window { start, end: at(self.end).unwrap_or(u64::MAX) };
        if window.start >= window.end {
            return Err("--start must lie before --end".to_owned());
        }
        Ok(window)
    }

    /// Refuses topics that the recording does not have.
    fn known<'a>(&self, connections: impl Iterator<Item = &'a Connection>) -> Result<(), String> {
        let present: Vec<&str> = connections.map(|each| each.topic.as_str()).collect();
        match self.topics.iter().find(|topic| !present.contains(&topic.as_str())) {
            None => Ok(()),
            Some(topic) => Err(format!("{} has no topic {topic}", self.file.display())),
        }
    }

    fn wants(&self, each: &Connection) -> bool {
        self.topics.is_empty() || self.topics.contains(&each.topic)
    }
}

/// Writes the slice and says what is in it.
pub fn slice(options: &Options) -> Result<(), String> {
    match kind(&options.file)? {
        Kind::Bag => of_bag(options),
        _ => of_recordings(options),
    }
}

fn of_bag(options: &Options) -> Result<(), String> {
    let settings = options.output.of_bag()?;
    let bag = options.memory.open_whole(&options.file)?;
    let window = options.window(bag.time_range())?;
    options.known(bag.connections().iter())?;
    let made = bagpipe_rosbag::slice(&bag, window, |each| options.wants(each), settings)
        .map_err(|error| unreadable(&options.file, &error))?;
    options.output.write(&made.bytes)?;
    println!(
        "{}: {} messages, {} latched before them, {} chunks as they were",
        options.output.output.display(),
        made.messages,
        made.latched,
        made.whole_chunks
    );
    Ok(())
}

fn of_recordings(options: &Options) -> Result<(), String> {
    let settings = options.output.of_mcap()?;
    let recordings = options.memory.whole_recordings(&options.file)?;
    let window = options.window(recordings.time_range())?;
    options.known(recordings.connections())?;
    let made = recordings
        .slice(window, |each| options.wants(each), settings)
        .map_err(|error| failed(&options.file, &error))?;
    options.output.write(&made.bytes)?;
    let (path, bagpipe_mcap::Sliced { messages, latched, .. }) =
        (options.output.output.display(), made);
    println!("{path}: {messages} messages, {latched} latched before them");
    Ok(())
}

/// Seconds with at most nine decimals, exactly.
fn nanoseconds(text: &str) -> Result<u64, String> {
    let wrong = || format!("{text:?} is no number of seconds such as 12 or 12.5");
    let (seconds, decimals) = text.split_once('.').unwrap_or((text, ""));
    let digits = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
    if decimals.len() > 9 || seconds.is_empty() || !digits(seconds) || !digits(decimals) {
        return Err(wrong());
    }
    let seconds: u64 = seconds.parse().map_err(|_| wrong())?;
    let nanos: u64 = format!("{decimals:0<9}").parse().map_err(|_| wrong())?;
    seconds.checked_mul(1_000_000_000).and_then(|whole| whole.checked_add(nanos)).ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    #[test]
    fn seconds_are_exact() {
        assert_eq!(super::nanoseconds("12.5"), Ok(12_500_000_000));
        assert_eq!(super::nanoseconds("0.000000001"), Ok(1));
        for wrong in ["", ".", "-1", "1e3", "1.0000000001", "18446744074"] {
            assert!(super::nanoseconds(wrong).is_err(), "{wrong}");
        }
    }
}

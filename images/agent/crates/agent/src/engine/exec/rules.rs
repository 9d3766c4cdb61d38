//! What frames may come in which order, and how much of them.

use std::time::{Duration, Instant};

use bagpipe_wire::{Decoder, End, FrameType, OwnedFrame, PROTOCOL, from_map};
use rmpv::Value;
use serde::{Deserialize, Serialize};

use super::output::{REASON, unexpected};
use crate::case::failure::Failure;

/// Files that a program may give back: their list must fit into RESULT.
const MAX_FILES: usize = 1000;
/// Bytes of a file's name, as file systems have it.
const MAX_NAME: usize = 255;
/// Bytes of the program's own RESULT: it becomes a part of ours.
const MAX_RESULT: usize = 256 * 1024;
/// Maps in maps, as deep as JSON readers take without a thought.
const MAX_DEPTH: usize = 32;
/// METRIC goes on at most twice a second.
const METRIC_PAUSE: Duration = Duration::from_millis(500);

/// A file that the program gave back.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Entry {
    pub name: String,
    pub size: u64,
}

/// FILE, of which only this matters here: the rest goes on as it came.
#[derive(Debug, Deserialize)]
pub struct Announced {
    pub name: String,
    /// None: not known yet.
    pub size: Option<u64>,
}

/// Exactly as many bytes as FILE announced must follow it.
#[derive(Debug, Default)]
pub struct FileFlow {
    name: Option<String>,
    size: Option<u64>,
    came: u64,
}

impl FileFlow {
    /// A new file begins.
    pub fn begin(&mut self, file: &Announced) -> Result<(), String> {
        self.check_complete()?;
        *self = Self { name: Some(file.name.clone()), size: file.size, came: 0 };
        Ok(())
    }

    /// A piece of it.
    pub fn take(&mut self, length: u64) -> Result<(), String> {
        let Some(name) = &self.name else { return Err("DATA came before any FILE".to_owned()) };
        self.came += length;
        match self.size {
            Some(size) if self.came > size => {
                Err(format!("{name:?} has more than its {size} bytes"))
            }
            _ => Ok(()),
        }
    }

    /// Nothing of it is missing.
    pub fn check_complete(&self) -> Result<(), String> {
        match (&self.name, self.size) {
            (Some(name), Some(size)) if self.came < size => {
                Err(format!("{name:?} is to have {size} bytes, and {} came", self.came))
            }
            _ => Ok(()),
        }
    }
}

/// What becomes of a frame of the program.
#[derive(Debug, PartialEq, Eq)]
pub enum Way {
    /// To the worker.
    On,
    /// To the worker if it takes it now.
    IfThereIsRoom,
    /// Nowhere: it was for the agent.
    Kept,
}

/// What the program gave back so far.
#[derive(Debug)]
pub struct Emitted {
    pub files: Vec<Entry>,
    pub bytes: u64,
    pub result: Option<Value>,
    /// END came, and it was right.
    pub complete: bool,
    flow: FileFlow,
    budget: u64,
    first: bool,
    reported: Option<Instant>,
}

/// HELLO of the program: only its protocol matters.
#[derive(Deserialize)]
struct ProgramHello {
    #[serde(default)]
    protocol: Option<u32>,
}

/// END of the program.
#[derive(Deserialize)]
struct ProgramEnd {
    #[serde(flatten)]
    totals: End,
    /// The digest of its input's END, by which it says that it has read all.
    #[serde(default)]
    input: Option<u32>,
}

/// ABORT of the program.
#[derive(Deserialize)]
struct ProgramAbort {
    #[serde(default)]
    reason: String,
    #[serde(default)]
    message: String,
}

impl Emitted {
    /// Of at most `budget` bytes.
    pub fn new(budget: u64) -> Self {
        Self {
            files: Vec::new(),
            bytes: 0,
            result: None,
            complete: false,
            flow: FileFlow::default(),
            budget,
            first: true,
            reported: None,
        }
    }

    /// Checks a frame and says where it goes; `given` is what the program's input sums up to.
    pub fn take(
        &mut self,
        frame: &OwnedFrame,
        decoder: &Decoder,
        given: End,
    ) -> Result<Way, Failure> {
        if self.complete {
            return Err(unexpected(frame.kind, "after END"));
        }
        let first = std::mem::replace(&mut self.first, false);
        let payload = &frame.payload[..];
        match frame.kind {
            FrameType::Hello if first => check_hello(payload).map(|()| Way::Kept),
            FrameType::Hello => Err(unexpected(frame.kind, "after its first frame")),
            FrameType::File => self.begin(understood(payload, "FILE")?).map(|()| Way::On),
            FrameType::Data => self.data(payload.len() as u64).map(|()| Way::On),
            FrameType::Metric => Ok(self.metric()),
            FrameType::Result => self.keep_result(payload).map(|()| Way::Kept),
            FrameType::End => {
                let claimed = understood(payload, "END")?;
                self.end(&claimed, decoder, given).map(|()| Way::Kept)
            }
            FrameType::Abort => Err(aborted(understood(payload, "ABORT")?)),
            FrameType::Step | FrameType::Answer => Err(unexpected(frame.kind, "from a program")),
        }
    }

    fn begin(&mut self, file: Announced) -> Result<(), Failure> {
        self.flow.begin(&file).map_err(refused)?;
        check_name(&file.name).map_err(refused)?;
        if self.files.iter().any(|entry| entry.name == file.name) {
            return Err(refused(format!("two files are named {:?}", file.name)));
        }
        if self.files.len() == MAX_FILES {
            return Err(refused(format!("there are more than {MAX_FILES} files")));
        }
        self.check_budget(&file.name, file.size.unwrap_or(0))?;
        self.files.push(Entry { name: file.name, size: 0 });
        Ok(())
    }

    fn data(&mut self, length: u64) -> Result<(), Failure> {
        self.flow.take(length).map_err(refused)?;
        if let Some(entry) = self.files.last_mut() {
            entry.size += length;
            let name = entry.name.clone();
            self.check_budget(&name, length)?;
        }
        self.bytes += length;
        Ok(())
    }

    fn check_budget(&self, name: &str, more: u64) -> Result<(), Failure> {
        if more <= self.budget - self.bytes {
            return Ok(());
        }
        let message = format!(
            "{more} more bytes of {name:?} exceed what one case may give back, {} bytes in all, \
             of which {} are used: write less, or cut the input into smaller cases",
            self.budget, self.bytes
        );
        Err(Failure::new("RecorderBudgetExceeded", message))
    }

    fn metric(&mut self) -> Way {
        let now = Instant::now();
        if self.reported.is_some_and(|reported| now.duration_since(reported) < METRIC_PAUSE) {
            return Way::Kept;
        }
        self.reported = Some(now);
        Way::IfThereIsRoom
    }

    fn keep_result(&mut self, payload: &[u8]) -> Result<(), Failure> {
        self.flow.check_complete().map_err(refused)?;
        if self.result.is_some() {
            return Err(refused("a second RESULT came".to_owned()));
        }
        if payload.len() > MAX_RESULT {
            let length = payload.len();
            return Err(refused(format!("RESULT has {length} bytes, more than {MAX_RESULT}")));
        }
        let value: Value = understood(payload, "RESULT")?;
        if !value.is_map() {
            return Err(refused("RESULT is no map".to_owned()));
        }
        check_plain(&value, "RESULT", MAX_DEPTH).map_err(refused)?;
        self.result = Some(value);
        Ok(())
    }

    fn end(&mut self, claimed: &ProgramEnd, decoder: &Decoder, given: End) -> Result<(), Failure> {
        self.flow.check_complete().map_err(refused)?;
        decoder.check_end(claimed.totals).map_err(refused)?;
        if claimed.input.is_some_and(|input| input != given.digest) {
            return Err(refused("END's `input` is not the digest of the input's END".to_owned()));
        }
        self.complete = true;
        Ok(())
    }
}

fn check_hello(payload: &[u8]) -> Result<(), Failure> {
    let hello: ProgramHello = understood(payload, "HELLO")?;
    match hello.protocol {
        Some(protocol) if protocol != PROTOCOL => Err(refused(format!(
            "it speaks protocol {protocol}, and this agent {PROTOCOL}: use what belongs together"
        ))),
        _ => Ok(()),
    }
}

/// A plain name: the worker makes a file of it.
fn check_name(name: &str) -> Result<(), String> {
    let plain = !name.is_empty()
        && name.len() <= MAX_NAME
        && !matches!(name, "." | "..")
        && !name.chars().any(|letter| letter == '/' || letter == '\\' || letter.is_control());
    if plain {
        return Ok(());
    }
    let shown: String = name.chars().take(MAX_NAME).collect();
    Err(format!("{shown:?} is no plain file name: write one without slashes, such as tracks.csv"))
}

/// RESULT ends in JSON, which knows no bytes, no NaN and no keys but strings.
fn check_plain(value: &Value, place: &str, depth: usize) -> Result<(), String> {
    if depth == 0 {
        return Err(format!("{place} is nested deeper than {MAX_DEPTH}"));
    }
    match value {
        Value::Map(entries) => entries.iter().try_for_each(|(key, below)| {
            let Some(key) = key.as_str() else {
                return Err(format!("{place} has the key {key}, which is no string"));
            };
            check_plain(below, &format!("{place}.{key}"), depth - 1)
        }),
        Value::Array(items) => items
            .iter()
            .enumerate()
            .try_for_each(|(at, item)| check_plain(item, &format!("{place}[{at}]"), depth - 1)),
        Value::F32(number) if !number.is_finite() => Err(format!("{place} is {number}")),
        Value::F64(number) if !number.is_finite() => Err(format!("{place} is {number}")),
        Value::Binary(_) | Value::Ext(..) => {
            Err(format!("{place} is bytes: give them back as a FILE"))
        }
        Value::String(text) if text.as_str().is_none() => Err(format!("{place} is no UTF-8")),
        _ => Ok(()),
    }
}

fn refused(why: String) -> Failure {
    Failure::new(REASON, format!("the program's frames cannot be used: {why}"))
}

fn understood<T: serde::de::DeserializeOwned>(payload: &[u8], kind: &str) -> Result<T, Failure> {
    from_map(payload).map_err(|error| refused(format!("{kind} cannot be understood: {error}")))
}

/// The program's own words, of which there may be any number.
fn aborted(abort: ProgramAbort) -> Failure {
    let ProgramAbort { reason, message } = abort;
    let words = [reason, message].into_iter().filter(|word| !word.is_empty());
    let words: String = words.collect::<Vec<_>>().join(": ").chars().take(2000).collect();
    Failure::new("StackAborted", format!("the program gave up: {words}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_leave_the_folder_are_refused() {
        for name in ["", ".", "..", "../x", "a/b", "/etc/passwd", "a\\b", "a\0", "a\nb"] {
            assert!(check_name(name).is_err(), "{name:?}");
        }
        assert!(check_name(&"x".repeat(256)).is_err());
        for name in ["tracks.csv", "a b.bag", "Messung-ä.json", "..x", &"x".repeat(255)] {
            assert_eq!(check_name(name), Ok(()), "{name:?}");
        }
    }

    #[test]
    fn a_result_holds_what_json_can_say() {
        let nested = |value: Value| Value::Map(vec![("a".into(), Value::Array(vec![value]))]);
        assert_eq!(check_plain(&nested(1.5.into()), "RESULT", MAX_DEPTH), Ok(()));
        for (value, sentence) in [
            (Value::F64(f64::NAN), "RESULT.a[0] is NaN"),
            (Value::Binary(vec![1]), "RESULT.a[0] is bytes: give them back as a FILE"),
            (
                Value::Map(vec![(1.into(), 2.into())]),
                "RESULT.a[0] has the key 1, which is no string",
            ),
        ] {
            assert_eq!(check_plain(&nested(value), "RESULT", MAX_DEPTH), Err(sentence.to_owned()));
        }
        let deep = (0..MAX_DEPTH).fold(Value::Nil, |below, _| Value::Array(vec![below]));
        assert!(check_plain(&deep, "RESULT", MAX_DEPTH).is_err_and(|why| why.contains("deeper")));
    }

    #[test]
    fn a_file_has_exactly_its_bytes() {
        let header = |size| Announced { name: "a".to_owned(), size: Some(size) };
        let mut flow = FileFlow::default();
        assert_eq!(flow.take(1), Err("DATA came before any FILE".to_owned()));
        flow.begin(&header(3)).unwrap();
        flow.take(2).unwrap();
        let missing = "\"a\" is to have 3 bytes, and 2 came".to_owned();
        assert_eq!(flow.check_complete(), Err(missing.clone()));
        assert_eq!(flow.begin(&header(0)), Err(missing));
        assert_eq!(flow.take(2), Err("\"a\" has more than its 3 bytes".to_owned()));
        flow = FileFlow::default();
        flow.begin(&Announced { name: "b".to_owned(), size: None }).unwrap();
        flow.take(1 << 40).unwrap();
        assert_eq!(flow.check_complete(), Ok(()));
    }
}

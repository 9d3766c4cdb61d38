//! A process's output: passed on to the agent's own stderr, and its last lines kept.

use std::collections::VecDeque;
use std::io::Read;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Lines kept.
const LINES: usize = 50;
/// Bytes kept.
const BYTES: usize = 8 * 1024;
/// A longer line is cut into pieces.
const LINE_BYTES: usize = 2 * 1024;

/// Follows one stream until its last writer has closed it.
#[derive(Debug)]
pub struct Tail {
    kept: Arc<Mutex<Kept>>,
    thread: JoinHandle<()>,
}

#[derive(Debug, Default)]
struct Kept {
    lines: VecDeque<String>,
    bytes: usize,
}

impl Tail {
    /// `prefix` goes before each line that is passed on.
    pub fn follow(stream: impl Read + Send + 'static, prefix: String) -> Self {
        let kept = Arc::new(Mutex::new(Kept::default()));
        let shared = Arc::clone(&kept);
        let thread = std::thread::spawn(move || follow(stream, &prefix, &shared));
        Self { kept, thread }
    }

    /// The last lines so far.
    pub fn lines(&self) -> Vec<String> {
        lock(&self.kept).lines.iter().cloned().collect()
    }

    /// The last lines, once the stream has ended or `patience` has.
    pub fn finish(self, patience: Duration) -> Vec<String> {
        let begun = Instant::now();
        while !self.thread.is_finished() && begun.elapsed() < patience {
            crate::stack::processes::pause(Duration::from_millis(1));
        }
        self.lines()
    }
}

fn follow(mut stream: impl Read, prefix: &str, kept: &Mutex<Kept>) {
    let mut line = Vec::new();
    let mut buffer = [0; 4096];
    loop {
        let length = match stream.read(&mut buffer) {
            Ok(0) => break,
            Ok(length) => length,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(_) => break,
        };
        for byte in &buffer[..length] {
            if *byte == b'\n' || line.len() >= LINE_BYTES {
                pass_on(&mut line, prefix, kept);
            }
            if *byte != b'\n' {
                line.push(*byte);
            }
        }
    }
    if !line.is_empty() {
        pass_on(&mut line, prefix, kept);
    }
}

fn pass_on(line: &mut Vec<u8>, prefix: &str, kept: &Mutex<Kept>) {
    let text = plain(&String::from_utf8_lossy(line));
    line.clear();
    eprintln!("{prefix} {text}");
    lock(kept).push(text);
}

/// Without colours and other control characters: ROS colours its warnings even into pipes,
/// and these lines end up in a Kubernetes condition.
fn plain(line: &str) -> String {
    let mut plain = String::with_capacity(line.len());
    let mut letters = line.chars().peekable();
    while let Some(letter) = letters.next() {
        if letter == '\x1b' && letters.next_if_eq(&'[').is_some() {
            // An escape sequence ends at its first letter.
            letters.find(|letter| ('@'..='~').contains(letter));
        } else if letter == '\t' || !letter.is_control() {
            plain.push(letter);
        }
    }
    plain
}

impl Kept {
    fn push(&mut self, line: String) {
        self.bytes += line.len();
        self.lines.push_back(line);
        while self.lines.len() > LINES || self.bytes > BYTES {
            self.bytes -= self.lines.pop_front().map_or(self.bytes, |line| line.len());
        }
    }
}

/// A panic while the lock was held cannot leave these lines in a bad state.
fn lock(kept: &Mutex<Kept>) -> MutexGuard<'_, Kept> {
    kept.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(text: &str) -> Vec<String> {
        let stream = std::io::Cursor::new(text.to_owned());
        Tail::follow(stream, "[test]".to_owned()).finish(Duration::from_secs(60))
    }

    #[test]
    fn the_last_fifty_lines_are_kept() {
        let text: String = (0..120).map(|number| format!("line {number}\r\n")).collect();
        let lines = kept(&text);
        assert_eq!((lines.len(), &*lines[0], &*lines[49]), (50, "line 70", "line 119"));
        assert_eq!(kept("no newline"), ["no newline"]);
    }

    #[test]
    fn colours_are_left_out() {
        assert_eq!(
            kept("\x1b[33m[ WARN] [1.5]: old\x1b[0m\ta\x07b\r\n"),
            ["[ WARN] [1.5]: old\tab"]
        );
        assert_eq!(kept("\x1b[1;31"), [""]);
    }

    #[test]
    fn a_line_without_end_takes_no_memory() {
        let lines = kept(&"z".repeat(1_000_000));
        assert_eq!(lines.len(), 4);
        assert!(lines.iter().map(String::len).sum::<usize>() <= 8 * 1024);
    }
}

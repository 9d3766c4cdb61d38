//! Messages out of a TCPROS connection's bytes: each is a `u32` length and so many bytes.

use std::io::{self, Read};

/// The least room for a read, in bytes.
const ROOM: usize = 256 << 10;

/// What one connection has sent and nobody has taken yet.
pub(crate) struct Frames {
    buffer: Vec<u8>,
    start: usize,
    end: usize,
}

/// What comes next of a connection.
#[derive(Debug, PartialEq)]
pub(crate) enum Frame<'a> {
    /// A whole message, without its length.
    Whole(&'a [u8]),
    /// Nothing before more bytes have come.
    Unfinished,
    /// A message has begun, and its end has not come yet.
    Part,
    /// A message of so many bytes is announced, more than accepted.
    TooLarge(usize),
}

impl Frames {
    /// Nothing yet.
    pub(crate) fn new() -> Self {
        Self { buffer: vec![0; ROOM], start: 0, end: 0 }
    }

    /// Reads once; 0 at the stream's end.
    pub(crate) fn fill(&mut self, from: &mut impl Read) -> io::Result<usize> {
        self.make_room();
        let read = from.read(&mut self.buffer[self.end..])?;
        self.end += read;
        Ok(read)
    }

    /// Whether nothing is left that was read.
    pub(crate) fn is_empty(&self) -> bool {
        self.start == self.end
    }

    /// Takes the next message, of at most `max_message` bytes.
    pub(crate) fn next(&mut self, max_message: usize) -> Frame<'_> {
        let bytes = &self.buffer[self.start..self.end];
        let Some((length, rest)) = bytes.split_first_chunk::<4>() else {
            return Frame::Unfinished;
        };
        let length = u32::from_le_bytes(*length) as usize;
        if length > max_message {
            return Frame::TooLarge(length);
        }
        let Some(data) = rest.get(..length) else {
            return Frame::Part;
        };
        self.start += 4 + length;
        Frame::Whole(data)
    }

    /// Moves what is left to the front and grows by doubling as bytes really arrive: a
    /// length that lies costs no memory.
    fn make_room(&mut self) {
        if self.start > 0 && (self.start == self.end || self.buffer.len() - self.end < ROOM / 2) {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        }
        if self.end == self.buffer.len() {
            self.buffer.resize(self.buffer.len() * 2, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stream that gives so many bytes at a time.
    struct Pieces<'a>(&'a [u8], usize);

    impl Read for Pieces<'_> {
        fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
            let length = self.1.min(into.len()).min(self.0.len());
            into[..length].copy_from_slice(&self.0[..length]);
            self.0 = &self.0[length..];
            Ok(length)
        }
    }

    #[test]
    fn messages_come_out_of_pieces_of_any_size() {
        let lengths = [0, 1, ROOM - 3, 3, 2 * ROOM, 5];
        let mut bytes = Vec::new();
        for (number, length) in lengths.iter().enumerate() {
            bytes.extend_from_slice(&(*length as u32).to_le_bytes());
            bytes.extend(std::iter::repeat_n(number as u8, *length));
        }
        bytes.extend_from_slice(&100u32.to_le_bytes());
        for size in [1000, 4099, usize::MAX] {
            let (mut frames, mut stream) = (Frames::new(), Pieces(&bytes, size));
            let mut found = Vec::new();
            while frames.fill(&mut stream).unwrap() > 0 {
                while let Frame::Whole(data) = frames.next(usize::MAX) {
                    assert!(data.iter().all(|byte| usize::from(*byte) == found.len()));
                    found.push(data.len());
                }
            }
            assert_eq!(found, lengths, "{size} bytes at a time");
            assert_eq!(frames.next(99), Frame::TooLarge(100));
            assert_eq!(frames.next(100), Frame::Part);
        }
    }

    #[test]
    fn a_length_that_lies_costs_no_memory() {
        let mut bytes = u32::MAX.to_le_bytes().to_vec();
        bytes.resize(ROOM + 10, 7);
        let (mut frames, mut stream) = (Frames::new(), &bytes[..]);
        while frames.fill(&mut stream).unwrap() > 0 {}
        assert_eq!(frames.next(usize::MAX), Frame::Part);
        assert_eq!(frames.buffer.len(), 2 * ROOM);
    }
}

//! One thread that reads every publisher's connection and hands each message, in the
//! order of arrival, to one sink. While the sink works nothing is read, so TCP holds the
//! publishers back: messages wait, none is dropped here.

use std::io::ErrorKind;
use std::net::TcpStream;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use bagpipe_graph::{Incoming, Publisher, Sink};
use rustix::event::{PollFd, PollFlags};

use crate::RosError;
use crate::frames::{Frame, Frames};
use crate::sockets::{Waker, lock, wait};

/// What one connection may hand over before the next one has its turn, in bytes.
const TURN: usize = 1 << 20;

/// A connection that has shaken hands.
pub(crate) struct InLink {
    pub(crate) id: u64,
    pub(crate) topic: Arc<str>,
    pub(crate) uri: String,
    pub(crate) publisher: Publisher,
    pub(crate) stream: TcpStream,
    pub(crate) counts: Arc<Counts>,
}

/// What a connection has handed over, for whoever asks for our statistics.
#[derive(Debug, Default)]
pub(crate) struct Counts {
    pub(crate) messages: AtomicU64,
    pub(crate) bytes: AtomicU64,
}

/// The way into the inbox for connectors.
pub(crate) struct Inbox {
    new: Mutex<Option<Sender<InLink>>>,
    waker: Waker,
    /// How often every socket has been looked at.
    rounds: Mutex<u64>,
    another: Condvar,
}

impl Inbox {
    /// Starts the thread. `closed` is called with the topic and the publisher's slave URI of
    /// each connection that ends; it must not block.
    pub(crate) fn start(
        sink: Box<dyn Sink>,
        max_message: usize,
        closed: impl Fn(&str, &str) + Send + 'static,
    ) -> Result<(Arc<Inbox>, JoinHandle<()>), RosError> {
        let (new, incoming) = channel();
        let waker = Waker::new().map_err(RosError::io("the recorder can't be woken"))?;
        let inbox = Arc::new(Inbox {
            new: Mutex::new(Some(new)),
            waker,
            rounds: Mutex::new(0),
            another: Condvar::new(),
        });
        let reader = Reader { inbox: Arc::clone(&inbox), sink, max_message, closed };
        let thread = std::thread::Builder::new()
            .name("inbox".into())
            .spawn(move || reader.run(&incoming))
            .map_err(RosError::io("the recorder's thread can't start"))?;
        Ok((inbox, thread))
    }

    /// Hands a connection over.
    pub(crate) fn add(&self, link: InLink) {
        if let Some(new) = lock(&self.new).as_ref() {
            // A receiver that is gone has stopped reading: the link closes with the message.
            let _stopped = new.send(link);
        }
        self.waker.wake();
    }

    /// Waits until everything that lies in our sockets now has been handed to the sink, at
    /// most for `limit`.
    pub(crate) fn sweep(&self, limit: Duration) {
        let rounds = lock(&self.rounds);
        // The present round may have passed a socket by before it got its bytes.
        let enough = *rounds + 2;
        self.waker.wake();
        let before = |rounds: &mut u64| {
            if *rounds < enough {
                self.waker.wake();
            }
            *rounds < enough
        };
        // A poisoned lock means that the reader is gone: nothing more will be handed over.
        let _swept = self.another.wait_timeout_while(rounds, limit, before);
    }

    /// Ends the thread.
    pub(crate) fn stop(&self) {
        lock(&self.new).take();
        self.waker.wake();
    }
}

struct Reader<C> {
    inbox: Arc<Inbox>,
    sink: Box<dyn Sink>,
    max_message: usize,
    closed: C,
}

/// A connection with the bytes that do not yet make a message.
struct Stream {
    link: InLink,
    frames: Frames,
}

impl<C: Fn(&str, &str)> Reader<C> {
    fn run(mut self, incoming: &Receiver<InLink>) {
        let mut streams: Vec<Stream> = Vec::new();
        let mut ready = Vec::new();
        loop {
            match wait_for_any(&self.inbox.waker, &streams, &mut ready) {
                Ok(true) => self.inbox.waker.clear(),
                Ok(false) => {}
                Err(_) => return,
            }
            loop {
                match incoming.try_recv() {
                    Ok(link) => streams.push(Stream::new(link)),
                    Err(std::sync::mpsc::TryRecvError::Empty) => break,
                    Err(std::sync::mpsc::TryRecvError::Disconnected) => return,
                }
            }
            for &at in ready.iter().rev() {
                if !streams[at].turn(self.sink.as_mut(), self.max_message) {
                    let gone = streams.swap_remove(at);
                    (self.closed)(&gone.link.topic, &gone.link.uri);
                }
            }
            *lock(&self.inbox.rounds) += 1;
            self.inbox.another.notify_all();
        }
    }
}

/// Waits; fills `ready` with the streams that can be read. `true` if the waker woke us.
fn wait_for_any(
    waker: &Waker,
    streams: &[Stream],
    ready: &mut Vec<usize>,
) -> std::io::Result<bool> {
    let mut fds = Vec::with_capacity(streams.len() + 1);
    fds.push(waker.poll_fd());
    fds.extend(streams.iter().map(|s| PollFd::new(&s.link.stream, PollFlags::IN)));
    wait(&mut fds, Duration::from_secs(1))?;
    ready.clear();
    ready.extend((0..streams.len()).filter(|at| !fds[at + 1].revents().is_empty()));
    Ok(!fds[0].revents().is_empty())
}

impl Stream {
    fn new(link: InLink) -> Stream {
        Stream { link, frames: Frames::new() }
    }

    /// Reads and hands over until the socket is empty or the turn is over; `false` when
    /// the connection has ended.
    fn turn(&mut self, sink: &mut dyn Sink, max_message: usize) -> bool {
        let mut handed = 0;
        while handed < TURN {
            match self.frames.fill(&mut self.link.stream) {
                Ok(0) => return false,
                Ok(read) => {
                    handed += read;
                    if !self.hand_over(sink, max_message) {
                        return false;
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return true,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return false,
            }
        }
        true
    }

    /// Hands whole messages to the sink; `false` if a message is larger than accepted.
    fn hand_over(&mut self, sink: &mut dyn Sink, max_message: usize) -> bool {
        let InLink { topic, publisher, id, counts, .. } = &self.link;
        loop {
            let data = match self.frames.next(max_message) {
                Frame::Whole(data) => data,
                Frame::Unfinished => return true,
                Frame::Part => {
                    sink.part();
                    return true;
                }
                Frame::TooLarge(length) => {
                    sink.too_large(topic, length as u64);
                    return false;
                }
            };
            sink.message(Incoming { topic, publisher, link: *id, data });
            counts.messages.fetch_add(1, Ordering::Relaxed);
            counts.bytes.fetch_add(data.len() as u64, Ordering::Relaxed);
        }
    }
}

//! One thread that reads every publisher's connection and hands each message, in the
//! order of arrival, to one sink. While the sink works nothing is read, so TCP holds the
//! publishers back: messages wait, none is dropped here.

use std::collections::BTreeMap;
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
    rounds: Mutex<Rounds>,
    another: Condvar,
}

/// What the thread has done.
#[derive(Debug, Default)]
struct Rounds {
    /// How often every socket has been looked at.
    number: u64,
    /// Connections that were not read to the end of a message and of what lay there, by the round
    /// since which that is so.
    behind: BTreeMap<u64, u64>,
    /// Those of them that were waited for in vain: they are not waited for again.
    given_up: BTreeMap<u64, u64>,
}

impl Rounds {
    /// Takes in a round.
    fn end(&mut self, streams: &[Stream]) {
        self.number += 1;
        let behind = streams.iter().filter_map(|stream| Some((stream.link.id, stream.behind?)));
        self.behind = behind.collect();
    }

    /// Whether all has been read that lay there before a round.
    fn have_read(&self, enough: u64) -> bool {
        let given_up = |link, since| self.given_up.get(link) == Some(since);
        let mut behind = self.behind.iter();
        self.number >= enough
            && !behind.any(|(link, since)| *since < enough && !given_up(link, since))
    }

    /// Takes in that what lay there before a round was waited for in vain.
    fn give_up(&mut self, enough: u64) {
        self.given_up = self.behind.clone();
        self.given_up.retain(|_, since| *since < enough);
    }
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
            rounds: Mutex::default(),
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

    /// Waits until everything that lies in our sockets now has been handed to the sink, and the whole of
    /// each message that has begun to come, at most for `limit`.
    pub(crate) fn sweep(&self, limit: Duration) {
        let rounds = lock(&self.rounds);
        // The present round may have passed a socket by before it got its bytes.
        let enough = rounds.number + 2;
        self.waker.wake();
        let before = |rounds: &mut Rounds| {
            if rounds.number < enough {
                self.waker.wake();
            }
            !rounds.have_read(enough)
        };
        // A poisoned lock means that the reader is gone: nothing more will be handed over.
        if let Ok((mut rounds, waited)) = self.another.wait_timeout_while(rounds, limit, before)
            && waited.timed_out()
        {
            rounds.give_up(enough);
        }
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
    /// Since which round it was not read to the end of a message and of what lay there.
    behind: Option<u64>,
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
            let round = lock(&self.inbox.rounds).number;
            for &at in ready.iter().rev() {
                if !streams[at].turn(self.sink.as_mut(), self.max_message, round) {
                    let gone = streams.swap_remove(at);
                    (self.closed)(&gone.link.topic, &gone.link.uri);
                }
            }
            lock(&self.inbox.rounds).end(&streams);
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
        Stream { link, frames: Frames::new(), behind: None }
    }

    /// Reads and hands over until the socket is empty or the turn is over; `false` when
    /// the connection has ended.
    fn turn(&mut self, sink: &mut dyn Sink, max_message: usize, round: u64) -> bool {
        match self.read(sink, max_message) {
            Some(empty) if empty && self.frames.is_empty() => self.behind = None,
            Some(_) => _ = self.behind.get_or_insert(round),
            None => return false,
        }
        true
    }

    /// Whether the socket is empty, or else the turn is over; `None` when the connection has ended.
    fn read(&mut self, sink: &mut dyn Sink, max_message: usize) -> Option<bool> {
        let mut handed = 0;
        while handed < TURN {
            match self.frames.fill(&mut self.link.stream) {
                Ok(0) => return None,
                Ok(read) => {
                    handed += read;
                    if !self.hand_over(sink, max_message) {
                        return None;
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Some(true),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return None,
            }
        }
        Some(false)
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

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::net::{Ipv4Addr, TcpListener};
    use std::time::Instant;

    use super::*;

    const LIMIT: Duration = Duration::from_secs(20);

    /// Counts messages, and takes its time; takes none before its gate is open.
    struct Gate {
        open: Receiver<()>,
        messages: Arc<AtomicU64>,
    }

    impl Sink for Gate {
        fn message(&mut self, _: Incoming<'_>) {
            if self.messages.load(Ordering::SeqCst) == 0 {
                let _opened = self.open.recv();
            }
            std::thread::sleep(Duration::from_millis(1));
            self.messages.fetch_add(1, Ordering::SeqCst);
        }

        fn too_large(&mut self, _: &str, _: u64) {}
    }

    struct Scene {
        inbox: Arc<Inbox>,
        reader: Option<JoinHandle<()>>,
        open: Sender<()>,
        messages: Arc<AtomicU64>,
        counts: Arc<Counts>,
        publisher: TcpStream,
    }

    impl Scene {
        fn new() -> Scene {
            let (open, gate) = channel();
            let messages = Arc::new(AtomicU64::new(0));
            let sink = Box::new(Gate { open: gate, messages: Arc::clone(&messages) });
            let (inbox, reader) = Inbox::start(sink, 1 << 30, |_, _| {}).unwrap();
            let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
            let publisher = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
            let stream = listener.accept().unwrap().0;
            stream.set_nonblocking(true).unwrap();
            let counts = Arc::new(Counts::default());
            inbox.add(InLink {
                id: 1,
                topic: "/out".into(),
                uri: String::new(),
                publisher: Publisher::default(),
                stream,
                counts: Arc::clone(&counts),
            });
            Scene { inbox, reader: Some(reader), open, messages, counts, publisher }
        }

        fn publish(&mut self, length: u32) {
            self.publisher.write_all(&length.to_le_bytes()).unwrap();
            self.publisher.write_all(&vec![7; length as usize]).unwrap();
        }

        fn messages(&self) -> u64 {
            self.messages.load(Ordering::SeqCst)
        }

        /// Waits until the reader has seen a message that has only begun.
        fn await_begun(&self) {
            let until = Instant::now() + LIMIT;
            while lock(&self.inbox.rounds).behind.is_empty() {
                assert!(Instant::now() < until);
                std::thread::sleep(Duration::from_millis(1));
            }
        }

        fn open(&self) {
            self.open.send(()).unwrap();
            let until = Instant::now() + LIMIT;
            while self.messages() == 0 {
                assert!(Instant::now() < until);
                std::thread::yield_now();
            }
        }
    }

    impl Drop for Scene {
        fn drop(&mut self) {
            let _open_already = self.open.send(());
            self.inbox.stop();
            self.reader.take().unwrap().join().unwrap();
        }
    }

    #[test]
    fn a_sweep_takes_in_all_that_lies_in_a_socket_also_if_it_is_more_than_a_turn() {
        let mut scene = Scene::new();
        scene.publisher.set_nonblocking(true).unwrap();
        let message = [&60_000u32.to_le_bytes()[..], &[7; 60_000]].concat();
        let (mut bytes, mut until) = (0, Instant::now() + LIMIT);
        // Until the kernel takes no more, on either side.
        while Instant::now() < until {
            match scene.publisher.write(&message[bytes % message.len()..]) {
                Ok(written) => {
                    bytes += written;
                    let enough = bytes > 2 * TURN;
                    until =
                        Instant::now() + if enough { Duration::from_millis(200) } else { LIMIT };
                }
                Err(_) => std::thread::sleep(Duration::from_millis(10)),
            }
        }
        let published = (bytes / message.len() + 1) as u64;
        assert!(bytes > 2 * TURN, "{bytes}");
        scene.open();
        scene.publisher.set_nonblocking(false).unwrap();
        scene.publisher.write_all(&message[bytes % message.len()..]).unwrap();
        scene.inbox.sweep(LIMIT);
        assert_eq!(scene.messages(), published, "{bytes}");
    }

    #[test]
    fn a_sweep_gives_up_no_connection_that_it_did_not_wait_for() {
        // The second one's message began after what the sweep waited for.
        let behind = BTreeMap::from([(1, 0), (2, 7)]);
        let mut rounds = Rounds { number: 8, behind, given_up: BTreeMap::new() };
        assert!(!rounds.have_read(5));
        rounds.give_up(5);
        assert!(rounds.have_read(5));
        rounds.number = 10;
        assert!(!rounds.have_read(10));
        rounds.behind.remove(&2);
        assert!(rounds.have_read(10));
    }

    #[test]
    fn a_sweep_awaits_the_rest_of_a_message_that_has_begun_and_once_in_vain() {
        let mut scene = Scene::new();
        scene.open.send(()).unwrap();
        scene.publish(10);
        scene.inbox.sweep(LIMIT);
        assert_eq!(scene.messages(), 1);
        scene.publisher.write_all(&8u32.to_le_bytes()).unwrap();
        scene.publisher.write_all(&[1; 4]).unwrap();
        let mut rest = scene.publisher.try_clone().unwrap();
        let late = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(200));
            rest.write_all(&[1; 4]).unwrap();
        });
        scene.inbox.sweep(LIMIT);
        assert_eq!(scene.messages(), 2);
        late.join().unwrap();
        // One that never ends holds up no more than one sweep.
        scene.publisher.write_all(&8u32.to_le_bytes()).unwrap();
        scene.await_begun();
        scene.inbox.sweep(Duration::from_millis(200));
        let begun = Instant::now();
        scene.inbox.sweep(LIMIT);
        assert!(begun.elapsed() < LIMIT / 2);
        assert_eq!(scene.counts.messages.load(Ordering::Relaxed), 2);
    }
}

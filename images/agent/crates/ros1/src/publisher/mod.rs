//! Publishing over TCPROS without ever dropping a message.
//!
//! A frame is what TCPROS puts on the wire for a message: `u32` little-endian length and
//! the serialised message. [`Outlet::send`] writes the caller's own memory to every
//! subscriber's socket and waits for the slowest; nothing is copied and nothing is queued
//! here, so what was sent is either in a socket or received.

use std::collections::BTreeMap;
use std::io::{ErrorKind, IoSlice, Write};
use std::net::TcpStream;
use std::sync::{Arc, Mutex, MutexGuard, TryLockError};
use std::time::{Duration, Instant};

use bagpipe_graph::{
    Cancelled, FarEnd, HANGS, LinkState, Outlet, Publication as Advertised, SendError, Share,
    TopicInfo, Waits,
};

use crate::header::ConnectionHeader;
use crate::peer_queue;
use crate::sockets::{lock, peer_has_closed, unsent, wait_writable};

/// Frames gathered into one system call: the kernel's limit (UIO_MAXIOV).
const GATHER: usize = 1024;
/// Looks at a subscriber's socket that only let other threads run in between; then it
/// sleeps, so that a node that takes its time has the processor for itself.
const YIELDS: u32 = 20;
/// The sleep between two looks at a subscriber's socket.
const NAP: Duration = Duration::from_micros(50);
/// The longest wait between two looks at `cancelled`.
const LOOK: Duration = Duration::from_millis(20);

struct Link {
    state: LinkState,
    stream: TcpStream,
}

/// Last frame of a latched topic per publishing node of the recording.
type Latched = BTreeMap<String, (Share, Arc<[u8]>)>;

#[derive(Default)]
struct Links {
    all: Vec<Link>,
    latched: Latched,
    refused: Vec<String>,
}

impl Links {
    /// What is latched of which `known` has not this very frame.
    fn latched_beyond(&self, known: &Latched) -> Latched {
        let is_known = |publisher: &str, frame: &Arc<[u8]>| {
            known.get(publisher).is_some_and(|(_, known)| Arc::ptr_eq(known, frame))
        };
        let new = self.latched.iter().filter(|(publisher, (_, frame))| !is_known(publisher, frame));
        new.map(|(publisher, latched)| (publisher.clone(), latched.clone())).collect()
    }

    fn open(&self) -> impl Iterator<Item = &Link> {
        self.all.iter().filter(|link| link.state.open)
    }

    /// Bytes that the slowest subscriber has not read, in our sockets, or in its own where it is on
    /// this machine; and which one it is. 0 and 0 without any.
    fn unread(&self) -> (u64, u64) {
        self.open().map(|link| (link.unread(), link.state.id)).max().unwrap_or_default()
    }

    /// Takes in, once a wait is over, for whom it was.
    fn hold_up(&mut self, mut waits: Waits) {
        waits.end(Instant::now());
        for (id, time) in waits.into_all() {
            self.all
                .iter_mut()
                .filter(|link| link.state.id == id)
                .for_each(|link| link.hold_up(time));
        }
    }

    fn add(&mut self, mut link: Link) {
        link.state.id = self.all.len() as u64 + 1;
        self.all.push(link);
    }
}

/// An advertised topic and its subscribers.
pub struct Publication {
    info: TopicInfo,
    stall: Duration,
    links: Mutex<Links>,
}

impl Publication {
    /// A topic without subscribers; `stall` is how long a subscriber may take no byte.
    pub(crate) fn new(info: TopicInfo, stall: Duration) -> Publication {
        Publication { info, stall, links: Mutex::default() }
    }

    /// The node that has read the least, if one is there still.
    fn slowest(&self) -> Option<String> {
        // Marks those that have left, who have nothing more to read.
        self.subscribers();
        let links = lock(&self.links);
        links.open().max_by_key(|link| link.unread()).map(|link| link.state.node.clone())
    }

    /// Answers a subscriber's header and takes it in once it has read what is latched, so that no
    /// message overtakes that. The play does not wait until it has read what was latched when it came; from
    /// then on it does, so that it misses no more, and no longer than `stall`.
    pub(crate) fn welcome(
        &self,
        node_name: &str,
        header: &ConnectionHeader,
        mut stream: TcpStream,
    ) -> Result<(), String> {
        if let Err(why) = self.agrees(header) {
            let answer = ConnectionHeader::new().with("error", &why).encode();
            // The refusal holds whether or not the peer still listens.
            let _peer_gone = stream.write_all(&answer);
            lock(&self.links).refused.push(why.clone());
            return Err(why);
        }
        let io = |error: std::io::Error| error.to_string();
        stream.set_nodelay(true).map_err(io)?;
        stream.write_all(&self.greeting(node_name)).map_err(io)?;
        stream.set_nonblocking(true).map_err(io)?;
        let node = header.text("callerid").to_owned();
        let state = LinkState { node, open: true, ..LinkState::default() };
        let mut link = Link { state, stream };
        let first = lock(&self.links).latched_beyond(&Latched::new());
        self.send_latched(&mut link, &first, &mut || false)?;
        let mut links = lock(&self.links);
        let begun = Instant::now();
        let mut late = || begun.elapsed() >= self.stall;
        self.send_latched(&mut link, &links.latched_beyond(&first), &mut late)?;
        links.add(link);
        Ok(())
    }

    /// The links, which somebody may hold who reads what was latched while he came.
    fn links_unless(&self, cancelled: Cancelled<'_>) -> Result<MutexGuard<'_, Links>, SendError> {
        loop {
            match self.links.try_lock() {
                Ok(links) => return Ok(links),
                Err(TryLockError::Poisoned(poisoned)) => return Ok(poisoned.into_inner()),
                Err(TryLockError::WouldBlock) if cancelled() => return Err(SendError::Cancelled),
                Err(TryLockError::WouldBlock) => std::thread::sleep(NAP),
            }
        }
    }

    fn send_latched(
        &self,
        link: &mut Link,
        latched: &Latched,
        cancelled: Cancelled<'_>,
    ) -> Result<(), String> {
        for (share, frame) in latched.values() {
            self.send_to(link, *share, &[frame], cancelled)
                .map_err(|_| "it did not read the latched messages".to_owned())?;
        }
        Ok(())
    }

    fn agrees(&self, header: &ConnectionHeader) -> Result<(), String> {
        let TopicInfo { topic, datatype, md5sum, .. } = &self.info;
        let claimed = |name| header.get(name).unwrap_or("*");
        let differ = |ours: &str, theirs: &str| theirs != "*" && ours != "*" && theirs != ours;
        if !differ(md5sum, claimed("md5sum")) && !differ(datatype, claimed("type")) {
            return Ok(());
        }
        Err(format!(
            "{} subscribes to {topic} as {} (md5sum {}), but it was recorded as {datatype} \
             (md5sum {md5sum}): build the node with the recording's message definition",
            claimed("callerid"),
            claimed("type"),
            claimed("md5sum")
        ))
    }

    fn greeting(&self, node_name: &str) -> Vec<u8> {
        ConnectionHeader::new()
            .with("callerid", node_name)
            .with("latching", if self.info.latching { "1" } else { "0" })
            .with("md5sum", &self.info.md5sum)
            .with("message_definition", &self.info.definition)
            .with("topic", &self.info.topic)
            .with("type", &self.info.datatype)
            .encode()
    }

    fn send_to(
        &self,
        link: &mut Link,
        share: Share,
        frames: &[&[u8]],
        cancelled: Cancelled<'_>,
    ) -> Result<(), SendError> {
        let mut unsent = frames;
        let mut offset = 0;
        let mut progress = Instant::now();
        while let Some(first) = unsent.first() {
            match write_some(&mut link.stream, &first[offset..], &unsent[1..]) {
                Ok(written) if written > 0 => {
                    (unsent, offset) = advance(unsent, offset + written);
                    progress = Instant::now();
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    let waited = progress.elapsed();
                    if waited >= self.stall {
                        let (node, topic) = (link.state.node.clone(), self.info.topic.clone());
                        return Err(SendError::Stalled { node, topic, waited, why: HANGS });
                    }
                    if cancelled() {
                        return Err(SendError::Cancelled);
                    }
                    let full = Instant::now();
                    let failed = wait_writable(&link.stream, LOOK.min(self.stall)).is_err();
                    link.state.open &= !failed;
                    link.hold_up(full.elapsed());
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Ok(_) | Err(_) => link.state.open = false,
            }
            if !link.state.open {
                break;
            }
        }
        count(&mut link.state, share, &frames[..frames.len() - unsent.len()]);
        Ok(())
    }
}

impl Outlet for Publication {
    fn topic(&self) -> &str {
        &self.info.topic
    }

    fn latch(&self, publisher: &str, share: Share, frame: &[u8]) {
        lock(&self.links).latched.insert(publisher.to_owned(), (share, frame.into()));
    }

    fn send(
        &self,
        share: Share,
        frames: &[&[u8]],
        cancelled: Cancelled<'_>,
    ) -> Result<(), SendError> {
        let mut links = self.links_unless(cancelled)?;
        for link in links.all.iter_mut().filter(|link| link.state.open) {
            self.send_to(link, share, frames, cancelled)?;
        }
        Ok(())
    }

    fn await_unread(&self, window: u64, cancelled: Cancelled<'_>) -> Result<(), SendError> {
        let (mut before, mut progress, mut looks) = (u64::MAX, Instant::now(), 0);
        let mut waits = Waits::default();
        loop {
            let mut links = self.links_unless(cancelled)?;
            let (left, slowest) = links.unread();
            if left <= window {
                links.hold_up(waits);
                return Ok(());
            }
            drop(links);
            waits.for_room(slowest, Instant::now());
            if left != before {
                (before, progress) = (left, Instant::now());
            }
            let waited = progress.elapsed();
            if waited >= self.stall {
                let Some(node) = self.slowest() else { return Ok(()) };
                let topic = self.info.topic.clone();
                return Err(SendError::Stalled { node, topic, waited, why: HANGS });
            }
            if cancelled() {
                return Err(SendError::Cancelled);
            }
            looks += 1;
            if looks < YIELDS {
                std::thread::yield_now();
            } else {
                if looks % YIELDS == 0 {
                    // Marks the connections that were closed with bytes in them.
                    self.subscribers();
                }
                std::thread::sleep(NAP);
            }
        }
    }
}

impl Advertised for Publication {
    fn info(&self) -> &TopicInfo {
        &self.info
    }

    fn subscribers(&self) -> Vec<LinkState> {
        let mut links = lock(&self.links);
        for link in links.all.iter_mut().filter(|link| link.state.open) {
            link.state.open = !peer_has_closed(&link.stream);
        }
        links.all.iter().map(|link| link.state.clone()).collect()
    }

    fn unsent(&self) -> u64 {
        let links = lock(&self.links);
        let open = links.all.iter().filter(|link| link.state.open);
        open.map(|link| unsent(&link.stream).unwrap_or(0)).sum()
    }

    fn far_ends(&self) -> Vec<FarEnd> {
        let links = lock(&self.links);
        links.all.iter().filter(|link| link.state.open).map(Link::far_end).collect()
    }

    fn refused(&self) -> Vec<String> {
        lock(&self.links).refused.clone()
    }
}

impl Link {
    /// Takes in how long was waited until it had room. Before the first message of the window nobody
    /// is held up.
    fn hold_up(&mut self, time: Duration) {
        if self.state.counted > 0 {
            self.state.held_up += time;
        }
    }

    fn unread(&self) -> u64 {
        self.far_end().unread
    }

    fn far_end(&self) -> FarEnd {
        let far = peer_queue::far_socket(&self.stream);
        FarEnd {
            id: self.state.id,
            unread: unsent(&self.stream).unwrap_or(0) + far.map_or(0, |far| far.unread),
            called_back: None,
            inode: far.map(|far| far.inode),
        }
    }
}

/// Takes in that these frames have been written.
fn count(state: &mut LinkState, share: Share, frames: &[&[u8]]) {
    let messages = frames.len() as u64;
    match share {
        Share::LeadIn => state.lead_in += messages,
        Share::Counted => {
            state.counted += messages;
            let bytes = frames.iter().map(|frame| frame.len() as u64 - 4);
            state.counted_bytes += bytes.sum::<u64>();
        }
    }
}

/// Writes the rest of a frame and, in the same call, the frames behind it.
fn write_some(stream: &mut TcpStream, rest: &[u8], more: &[&[u8]]) -> std::io::Result<usize> {
    if more.is_empty() {
        return stream.write(rest);
    }
    let mut slices = [IoSlice::new(&[]); GATHER];
    slices[0] = IoSlice::new(rest);
    let gathered = more.len().min(GATHER - 1);
    for (slice, frame) in slices[1..].iter_mut().zip(more) {
        *slice = IoSlice::new(frame);
    }
    stream.write_vectored(&slices[..=gathered])
}

/// The frames that are left when `written` bytes, counted from the first one's start,
/// have gone; and how much of the first of them has.
fn advance<'a, 'b>(frames: &'a [&'b [u8]], mut written: usize) -> (&'a [&'b [u8]], usize) {
    let mut left = frames;
    while let Some((first, rest)) = left.split_first() {
        if written < first.len() {
            break;
        }
        written -= first.len();
        left = rest;
    }
    (left, written)
}

#[cfg(test)]
mod tests;

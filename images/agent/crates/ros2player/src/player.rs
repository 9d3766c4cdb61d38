//! The player as its callers have it.

use std::ffi::OsString;
use std::io::IoSlice;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

use rustix::net::{SendAncillaryBuffer, SendAncillaryMessage, SendFlags};

use crate::control::{Answer, Control, Request, Verb, ended};
use crate::error::MOST_ROOM;
use crate::graph::{self, GraphNode};
use crate::layout::{ENDPOINTS, RECORD_MESSAGE, RECORD_TOO_LARGE, Record};
use crate::memory::{Memory, Which};
use crate::program::{Program, lock};
use crate::qos::Datatype;
use crate::ring::{self, Reader, Writer};
use crate::{PlayerError, Qos};

/// How long a wait may go without a look at the program and at who may cancel.
const LOOK: Duration = Duration::from_millis(20);
const LEAST_ROOM: u64 = 1 << 16;

const STATUS_DONE: u32 = 0;
const STATUS_LIBRARY: u32 = 1;
const STATUS_SYMBOL: u32 = 2;
const STATUS_PACKAGE: u32 = 3;
const STATUS_TYPE: u32 = 4;
const STATUS_RCL: u32 = 5;

/// How the program is started.
#[derive(Clone, Debug)]
pub struct PlayerOptions {
    /// A file with [`PROGRAM`](crate::PROGRAM), which may be executed.
    pub program: PathBuf,
    /// Variables that it gets besides this process's own: those of the user's sourced setup.
    pub environment: Vec<(OsString, OsString)>,
    /// Variables that it does not get, such as `LD_PRELOAD`.
    pub removed: Vec<OsString>,
    /// Its node's name.
    pub node: String,
    /// Its node's namespace, such as `/` or `/bagpipe`.
    pub namespace: String,
    /// Bytes of each of the two rings, taken as the next power of two from 64 KiB to 1 GiB. A
    /// message may have half of it, less 16 bytes. Over time all of it is memory in use.
    pub room: u64,
    /// The most that the start may take, and each call that asks the program something.
    pub deadline: Duration,
}

/// A publisher of one [`Player`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PublisherId(u16);

/// A subscription of one [`Player`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SubscriptionId(u16);

/// A message that was taken.
#[derive(Debug)]
pub struct Received<'ring> {
    /// By which subscription.
    pub subscription: SubscriptionId,
    /// When its publisher published it by its own clock, in nanoseconds since 1970; 0 where the
    /// middleware does not say.
    pub source_timestamp: i64,
    /// The serialised message with its encapsulation header, where it stands in the ring. Who has
    /// this memory as well can change it meanwhile: copy it before it is judged.
    pub data: &'ring [u8],
}

/// A program that runs in the user's environment, with a node in its ROS 2 graph. All calls may be
/// made from several threads at once. Dropping it ends the program, SIGTERM first and SIGKILL after
/// 1.5 s; messages that were not published by then are lost ([`flush`](Player::flush) first).
pub struct Player {
    program: Program,
    control: Control,
    memory: Memory,
    out: Mutex<Writer>,
    taken: Mutex<Reader>,
    publishers: Mutex<Vec<Publisher>>,
    subscriptions: Mutex<Vec<String>>,
    /// Messages of all publishers whose refusal was reported.
    reported: AtomicU64,
}

struct Publisher {
    topic: String,
    /// Messages whose refusal was reported.
    refused: u64,
}

impl Player {
    /// Starts the program; when this returns its node exists.
    ///
    /// # Errors
    /// The program can't be started, there is no ROS 2 in its environment, rcl makes no node, or
    /// not within the deadline.
    pub fn start(options: &PlayerOptions) -> Result<Player, PlayerError> {
        let room = options.room.max(LEAST_ROOM).checked_next_power_of_two();
        let room = room.filter(|room| *room <= MOST_ROOM).ok_or(PlayerError::Room(options.room))?;
        let memory = Memory::new(room as usize)?;
        let (near, far) = UnixStream::pair()?;
        send_file(&near, &memory)?;
        let player = Player {
            program: Program::start(options, far.into())?,
            control: Control::new(near, options.deadline),
            memory,
            out: Mutex::new(Writer::new(Which::Out)),
            taken: Mutex::new(Reader::new(Which::In)),
            publishers: Mutex::default(),
            subscriptions: Mutex::default(),
            reported: AtomicU64::new(0),
        };
        let request = Request::new(Verb::Start).text(&options.node).text(&options.namespace);
        player.ask("join the graph", &request, None)?;
        Ok(player)
    }

    /// The program's number.
    pub fn pid(&self) -> u32 {
        self.program.pid()
    }

    /// Makes a publisher. Give it [`History::KeepAll`](crate::History::KeepAll) or a depth that is
    /// no less than what is in flight at once: a publisher's queue overwrites as a subscription's.
    ///
    /// # Errors
    /// The type is not installed, rcl makes none, there are 1024, or the deadline is past.
    pub fn advertise(
        &self,
        topic: &str,
        datatype: &str,
        qos: &Qos,
    ) -> Result<PublisherId, PlayerError> {
        let publisher = Publisher { topic: topic.to_owned(), refused: 0 };
        let slot = slot(&self.publishers, publisher, topic)?;
        self.create(Verb::Advertise, slot, topic, datatype, qos)?;
        Ok(PublisherId(slot))
    }

    /// Hands a message to the program, which publishes it: the parts, one after the other. Waits
    /// for room, and asks `cancelled` at least every 20 ms meanwhile. Of one thread's messages the
    /// order is kept, over all publishers.
    ///
    /// # Errors
    /// [`TooLarge`](PlayerError::TooLarge), [`Cancelled`](PlayerError::Cancelled), the program has
    /// ended, or [`Refused`](PlayerError::Refused): earlier messages were, and this one was not
    /// handed over.
    pub fn publish(
        &self,
        publisher: PublisherId,
        parts: &[&[u8]],
        cancelled: &mut dyn FnMut() -> bool,
    ) -> Result<(), PlayerError> {
        self.check()?;
        known(&self.publishers, publisher.0)?;
        let length: usize = parts.iter().map(|part| part.len()).sum();
        let most = ring::most(self.memory.room());
        if length > most {
            let (length, most) = (length as u64, most as u64);
            return Err(PlayerError::TooLarge { topic: self.topic(publisher)?, length, most });
        }
        let record =
            Record { length: length as u32, endpoint: publisher.0, kind: RECORD_MESSAGE, stamp: 0 };
        let write = || lock(&self.out).write(&self.memory, record, parts);
        let mut written = write()?;
        while !written {
            if self.program.has_ended() {
                return Err(ended(&self.program));
            }
            if cancelled() {
                return Err(PlayerError::Cancelled);
            }
            let attempt = || {
                written = write()?;
                Ok(written)
            };
            ring::sleep_for_room(&self.memory, Which::Out, LOOK, attempt)?;
        }
        Ok(())
    }

    /// How many messages of it the middleware has taken.
    pub fn published(&self, publisher: PublisherId) -> u64 {
        let slot = self.memory.publisher.get(usize::from(publisher.0));
        slot.map_or(0, |slot| slot.published.load(SeqCst))
    }

    /// Waits until all that was handed over is published; false if it is not until the deadline.
    ///
    /// # Errors
    /// The program has ended, or messages were [`Refused`](PlayerError::Refused).
    pub fn flush(&self, deadline: Instant) -> Result<bool, PlayerError> {
        let is_empty = || Ok(lock(&self.out).waiting(&self.memory)? == 0);
        loop {
            let empty = is_empty()?;
            self.check()?;
            let left = deadline.saturating_duration_since(Instant::now());
            if empty || left.is_zero() {
                return Ok(empty);
            }
            ring::sleep_for_room(&self.memory, Which::Out, LOOK.min(left), is_empty)?;
        }
    }

    /// How many subscriptions its publisher has matched. That it has one does not say that the
    /// other side knows: a reader's own count does.
    ///
    /// # Errors
    /// rcl does not say, or not within the deadline.
    pub fn subscribers(&self, publisher: PublisherId) -> Result<u64, PlayerError> {
        known(&self.publishers, publisher.0)?;
        let request = Request::new(Verb::Subscribers).number(publisher.0.into());
        self.ask("count subscriptions", &request, None)?.long()
    }

    /// Makes a subscription, whose messages [`receive`](Player::receive) hands over.
    ///
    /// # Errors
    /// As [`advertise`](Player::advertise).
    pub fn subscribe(
        &self,
        topic: &str,
        datatype: &str,
        qos: &Qos,
    ) -> Result<SubscriptionId, PlayerError> {
        let slot = slot(&self.subscriptions, topic.to_owned(), topic)?;
        self.create(Verb::Subscribe, slot, topic, datatype, qos)?;
        Ok(SubscriptionId(slot))
    }

    /// How many publishers a subscription has matched.
    ///
    /// # Errors
    /// As [`subscribers`](Player::subscribers).
    pub fn publishers(&self, subscription: SubscriptionId) -> Result<u64, PlayerError> {
        known(&self.subscriptions, subscription.0)?;
        let request = Request::new(Verb::Publishers).number(subscription.0.into());
        self.ask("count publishers", &request, None)?.long()
    }

    /// Hands over all messages that were taken by now, in the order of the takes, and returns how
    /// many; waits for the first, for `limit` at the most. Nobody else receives meanwhile.
    ///
    /// # Errors
    /// The program has ended and nothing of it is left, a message was
    /// [too large](PlayerError::TooLarge), which the next call goes on behind, a subscription can
    /// [take](PlayerError::Take) no more, or the memory is damaged.
    pub fn receive(
        &self,
        limit: Duration,
        into: &mut dyn FnMut(Received<'_>),
    ) -> Result<usize, PlayerError> {
        let until = Instant::now() + limit;
        let mut taken = lock(&self.taken);
        loop {
            let over = self.program.has_ended();
            let count = self.hand_over(&mut taken, into)?;
            if count > 0 {
                return Ok(count);
            }
            if over {
                return Err(ended(&self.program));
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(0);
            }
            taken.sleep(&self.memory, LOOK.min(left))?;
        }
    }

    fn hand_over(
        &self,
        taken: &mut Reader,
        into: &mut dyn FnMut(Received<'_>),
    ) -> Result<usize, PlayerError> {
        let mut count = 0;
        if !taken.look(&self.memory)? {
            return Ok(count);
        }
        // Whatever has put something into the ring by now was listed before.
        let known = lock(&self.subscriptions).len();
        while let Some((record, data)) = taken.next(&self.memory)? {
            if record.kind == RECORD_MESSAGE {
                if usize::from(record.endpoint) >= known {
                    let what = format!("a message of subscription {}", record.endpoint);
                    return Err(taken.damage(&self.memory, what));
                }
                let subscription = SubscriptionId(record.endpoint);
                into(Received { subscription, source_timestamp: record.stamp, data });
            }
            let trouble = (record.kind != RECORD_MESSAGE).then(|| self.trouble(record, data));
            taken.done(&self.memory, record);
            match trouble {
                Some(error) => return Err(error),
                None => count += 1,
            }
        }
        Ok(count)
    }

    /// What a record says that is no message.
    fn trouble(&self, record: Record, data: &[u8]) -> PlayerError {
        let topic = lock(&self.subscriptions).get(usize::from(record.endpoint)).cloned();
        let topic = topic.unwrap_or_else(|| "all that was subscribed to".to_owned());
        if record.kind == RECORD_TOO_LARGE {
            let most = ring::most(self.memory.room()) as u64;
            return PlayerError::TooLarge { topic, length: record.stamp.cast_unsigned(), most };
        }
        PlayerError::Take { topic, reason: String::from_utf8_lossy(data).into_owned() }
    }

    /// How many messages of it the program has taken. By then they are in the ring: who receives
    /// after it has said 7 has had the seventh. It counts just after that.
    pub fn taken(&self, subscription: SubscriptionId) -> u64 {
        let slot = self.memory.subscription.get(usize::from(subscription.0));
        slot.map_or(0, |slot| slot.taken.load(SeqCst))
    }

    /// The nodes of the graph by now, the program's own among them; discovery takes its time.
    ///
    /// # Errors
    /// rcl does not say, or not within the deadline.
    pub fn graph(&self) -> Result<Vec<GraphNode>, PlayerError> {
        graph::read(&mut self.ask("list the graph", &Request::new(Verb::Graph), None)?)
    }

    fn create(
        &self,
        verb: Verb,
        slot: u16,
        topic: &str,
        datatype: &str,
        qos: &Qos,
    ) -> Result<(), PlayerError> {
        let Datatype { package, folder, name } = Datatype::parse(datatype)?;
        let mut request = Request::new(verb).number(slot.into()).text(topic);
        request = request.text(package).text(folder).text(name);
        for number in qos.numbers() {
            request = request.number(number);
        }
        self.ask(&format!("join {topic}"), &request, Some((topic, datatype, package)))?;
        Ok(())
    }

    /// Asks the program, and reads the status. `about`: topic, type and package of an endpoint.
    fn ask(
        &self,
        what: &str,
        request: &Request,
        about: Option<(&str, &str, &str)>,
    ) -> Result<Answer, PlayerError> {
        let mut answer = self.control.call(what, &self.program, request)?;
        match answer.number()? {
            STATUS_DONE => Ok(answer),
            other => Err(failure(other, &mut answer, about.unwrap_or_default())?),
        }
    }

    /// That the program runs, and that nothing was refused since this was last reported.
    fn check(&self) -> Result<(), PlayerError> {
        if self.program.has_ended() {
            return Err(ended(&self.program));
        }
        if self.memory.refused.load(SeqCst) == self.reported.load(SeqCst) {
            return Ok(());
        }
        let found = {
            let mut publishers = lock(&self.publishers);
            publishers.iter_mut().zip(&self.memory.publisher).zip(0..).find_map(
                |((publisher, slot), number)| {
                    let refused = slot.refused.load(SeqCst);
                    let count = refused.checked_sub(publisher.refused).filter(|more| *more > 0)?;
                    publisher.refused = refused;
                    Some((number, publisher.topic.clone(), count))
                },
            )
        };
        let Some((slot, topic, count)) = found else { return Ok(()) };
        self.reported.fetch_add(count, SeqCst);
        let request = Request::new(Verb::Refusal).number(slot);
        let reason = self.ask("explain a refusal", &request, None)?.text()?;
        Err(PlayerError::Refused { topic, count, reason })
    }

    fn topic(&self, publisher: PublisherId) -> Result<String, PlayerError> {
        let publishers = lock(&self.publishers);
        let one = publishers.get(usize::from(publisher.0)).ok_or(PlayerError::Stranger)?;
        Ok(one.topic.clone())
    }
}

/// A place in a list of endpoints, which stays taken if none is made: the program may make one when
/// nobody waits for it any more.
fn slot<T>(list: &Mutex<Vec<T>>, one: T, topic: &str) -> Result<u16, PlayerError> {
    let mut list = lock(list);
    let slot = list.len();
    if slot >= ENDPOINTS {
        return Err(PlayerError::TooMany { topic: topic.to_owned(), most: ENDPOINTS });
    }
    list.push(one);
    Ok(slot as u16)
}

fn known<T>(list: &Mutex<Vec<T>>, slot: u16) -> Result<(), PlayerError> {
    match usize::from(slot) < lock(list).len() {
        true => Ok(()),
        false => Err(PlayerError::Stranger),
    }
}

/// The error of an answer that says so.
fn failure(
    status: u32,
    answer: &mut Answer,
    (topic, datatype, package): (&str, &str, &str),
) -> Result<PlayerError, PlayerError> {
    let first = answer.text()?;
    let topic = topic.to_owned();
    Ok(match status {
        STATUS_LIBRARY => PlayerError::NoRos(first),
        STATUS_SYMBOL => PlayerError::Symbol(first),
        STATUS_PACKAGE => {
            let package = package.to_owned();
            PlayerError::Package { topic, package, library: first, reason: answer.text()? }
        }
        STATUS_TYPE => PlayerError::Type { topic, datatype: datatype.to_owned(), library: first },
        STATUS_RCL => PlayerError::Rcl {
            function: first,
            code: answer.number()?.cast_signed(),
            reason: answer.text()?,
        },
        _ => PlayerError::Answer(first),
    })
}

/// Sends the memory's file by a byte.
fn send_file(socket: &UnixStream, memory: &Memory) -> Result<(), PlayerError> {
    let files = [memory.file().as_fd()];
    let mut room = [std::mem::MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
    let mut ancillary = SendAncillaryBuffer::new(&mut room);
    ancillary.push(SendAncillaryMessage::ScmRights(&files));
    rustix::net::sendmsg(socket, &[IoSlice::new(&[0])], &mut ancillary, SendFlags::NOSIGNAL)
        .map_err(std::io::Error::from)?;
    Ok(())
}

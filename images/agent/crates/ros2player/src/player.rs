//! The player as its callers have it.

use std::collections::BTreeMap;
use std::io::IoSlice;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::sync::Mutex;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

use rustix::net::{SendAncillaryBuffer, SendAncillaryMessage, SendFlags};

use crate::control::{Answer, Control, Request, Verb, ended};
use crate::error::MOST_ROOM;
use crate::failure::{STATUS_DONE, failure};
use crate::graph::{self, GraphNode, GraphPublisher, GraphTypes};
use crate::layout::{ENDPOINTS, RECORD_MESSAGE, Record};
use crate::memory::{Memory, Which};
use crate::options::PlayerOptions;
use crate::program::{Program, lock};
use crate::qos::Datatype;
use crate::ring::{self, Reader, Staged, Writer};
use crate::security::Security;
use crate::{PlayerError, Qos};

/// How long a wait may go without a look at the program and at who may cancel.
pub(crate) const LOOK: Duration = Duration::from_millis(20);
const LEAST_ROOM: u64 = 1 << 16;

/// A publisher of one [`Player`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PublisherId(u16);

/// A subscription of one [`Player`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SubscriptionId(pub(crate) u16);

/// A program that runs in the user's environment, with a node in its ROS 2 graph. All calls may be
/// made from several threads at once. Dropping it ends the program, SIGTERM first and SIGKILL after
/// 1.5 s; messages that were not published by then are lost ([`flush`](Player::flush) first).
pub struct Player {
    pub(crate) program: Program,
    security: Option<Security>,
    control: Control,
    pub(crate) memory: Memory,
    out: Mutex<Writer>,
    pub(crate) taken: Mutex<Reader>,
    publishers: Mutex<Vec<Publisher>>,
    pub(crate) subscriptions: Mutex<Vec<String>>,
}

struct Publisher {
    topic: String,
    /// What its messages are known by in nodes that take them.
    gid: Option<[u8; 16]>,
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
            security: Security::of(options),
            control: Control::new(near, options.deadline),
            memory,
            out: Mutex::new(Writer::new(Which::Out)),
            taken: Mutex::new(Reader::new(Which::In)),
            publishers: Mutex::default(),
            subscriptions: Mutex::default(),
        };
        let request = Request::new(Verb::Start).text(&options.node).text(&options.namespace);
        player.ask("join the graph", &request, None)?;
        Ok(player)
    }

    /// The program's number.
    pub fn pid(&self) -> u32 {
        self.program.pid()
    }

    /// Has it publish each message when it is given it: a slow reader holds it up by 20 ms at the most, and
    /// a fourth of the time, where it would be waited for otherwise as long as it reads.
    pub fn keep_to_the_clock(&self) {
        self.memory.by_the_clock.store(1, SeqCst);
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
        let publisher = Publisher { topic: topic.to_owned(), gid: None, refused: 0 };
        let slot = slot(&self.publishers, publisher, topic)?;
        let gid = self.create(Verb::Advertise, slot, topic, datatype, qos)?.gid()?;
        if let Some(publisher) = lock(&self.publishers).get_mut(usize::from(slot)) {
            publisher.gid = gid;
        }
        Ok(PublisherId(slot))
    }

    /// What the messages of a publisher are known by in the nodes that take them: what rmw gives with
    /// each of them, or its GUID in Cyclone DDS. `None` if the middleware does not say.
    pub fn gid(&self, publisher: PublisherId) -> Option<[u8; 16]> {
        lock(&self.publishers).get(usize::from(publisher.0))?.gid
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
        let record = self.record(publisher, parts)?;
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

    /// Copies a message to where the program finds it once it is [released](Player::release), so that
    /// this takes no time then. `None` where there is no room now.
    ///
    /// # Errors
    /// As [`publish`](Player::publish).
    pub fn stage(
        &self,
        publisher: PublisherId,
        parts: &[&[u8]],
    ) -> Result<Option<Staged>, PlayerError> {
        let record = self.record(publisher, parts)?;
        lock(&self.out).stage(&self.memory, record, parts)
    }

    /// Hands over what was staged, as [`publish`](Player::publish) does; false if something else was
    /// staged or published since, so that it is to be published.
    ///
    /// # Errors
    /// The program has ended, or earlier messages were [`Refused`](PlayerError::Refused).
    pub fn release(&self, staged: Staged) -> Result<bool, PlayerError> {
        self.check()?;
        Ok(lock(&self.out).release(&self.memory, staged))
    }

    /// The head of a message, which fits.
    fn record(&self, publisher: PublisherId, parts: &[&[u8]]) -> Result<Record, PlayerError> {
        known(&self.publishers, publisher.0)?;
        let length: usize = parts.iter().map(|part| part.len()).sum();
        let most = ring::most(self.memory.room());
        if length > most {
            let (length, most) = (length as u64, most as u64);
            return Err(PlayerError::TooLarge { topic: self.topic(publisher)?, length, most });
        }
        let (length, endpoint) = (length as u32, publisher.0);
        Ok(Record { length, endpoint, kind: RECORD_MESSAGE, ..Record::default() })
    }

    /// How many messages of it the middleware has taken. One may be received before it is counted
    /// here; after [`flush`](Player::flush) all are.
    pub fn published(&self, publisher: PublisherId) -> u64 {
        let slot = self.memory.publisher.get(usize::from(publisher.0));
        slot.map_or(0, |slot| slot.published.load(SeqCst))
    }

    /// Waits until all that was handed over by now is published; false if it is not until the
    /// deadline.
    ///
    /// # Errors
    /// The program has ended, or messages were [`Refused`](PlayerError::Refused).
    pub fn flush(&self, deadline: Instant) -> Result<bool, PlayerError> {
        let until = lock(&self.out).written();
        let is_read = || {
            let out = lock(&self.out);
            Ok(out.written() - out.waiting(&self.memory)? >= until)
        };
        loop {
            let all = is_read()?;
            self.check()?;
            let left = deadline.saturating_duration_since(Instant::now());
            if all || left.is_zero() {
                return Ok(all);
            }
            ring::sleep_for_room(&self.memory, Which::Out, LOOK.min(left), is_read)?;
        }
    }

    /// How many subscriptions it has matched. What is published before goes to none, and what is
    /// published before the *reader* has matched as well is not taken: each side learns of the
    /// other by itself, in either order, so that both are to be waited for.
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

    /// The same, without what this player publishes itself, as far as the RMW can do that.
    ///
    /// # Errors
    /// As [`advertise`](Player::advertise).
    pub fn listen(
        &self,
        topic: &str,
        datatype: &str,
        qos: &Qos,
    ) -> Result<SubscriptionId, PlayerError> {
        let slot = slot(&self.subscriptions, topic.to_owned(), topic)?;
        self.create(Verb::Listen, slot, topic, datatype, qos)?;
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

    /// How many messages of it the program has taken. Those that this counts are in the ring, so that
    /// the next [`receive`](Player::receive) has them; one that was received may be counted later.
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

    /// The graph's topics by now, whichever nodes have them.
    ///
    /// # Errors
    /// As of [`Player::graph`].
    pub fn topics_of_graph(&self) -> Result<BTreeMap<String, GraphTypes>, PlayerError> {
        graph::read_topics(&mut self.ask("list the topics", &Request::new(Verb::Topics), None)?)
    }

    /// Who publishes a topic by now, the program itself among them.
    ///
    /// # Errors
    /// As of [`Player::graph`].
    pub fn publishers_of(&self, topic: &str) -> Result<Vec<GraphPublisher>, PlayerError> {
        let request = Request::new(Verb::Topic).text(topic);
        graph::read_publishers(&mut self.ask("list a topic's publishers", &request, None)?)
    }

    fn create(
        &self,
        verb: Verb,
        slot: u16,
        topic: &str,
        datatype: &str,
        qos: &Qos,
    ) -> Result<Answer, PlayerError> {
        let Datatype { package, folder, name } = Datatype::parse(datatype)?;
        let mut request = Request::new(verb).number(slot.into()).text(topic);
        request = request.text(package).text(folder).text(name);
        for number in qos.numbers() {
            request = request.number(number);
        }
        self.ask(&format!("join {topic}"), &request, Some((topic, datatype, package)))
    }

    /// Asks the program, and reads the status. `about`: topic, type and package of an endpoint.
    pub(crate) fn ask(
        &self,
        what: &str,
        request: &Request,
        about: Option<(&str, &str, &str)>,
    ) -> Result<Answer, PlayerError> {
        let mut answer = self.control.call(what, &self.program, request)?;
        match answer.number()? {
            STATUS_DONE => Ok(answer),
            other => {
                let error = failure(other, &mut answer, about.unwrap_or_default())?;
                Err(match &self.security {
                    Some(security) => security.explain(error, what, &self.program),
                    None => self.with_last_lines(error),
                })
            }
        }
    }

    /// The same error with what the middleware has written, if it is of those of which rcl has no word.
    fn with_last_lines(&self, mut error: PlayerError) -> PlayerError {
        if let PlayerError::Join { errors, .. } = &mut error {
            *errors = self.program.last_lines();
        }
        error
    }

    /// That the program runs, and that nothing was refused since this was last reported.
    fn check(&self) -> Result<(), PlayerError> {
        if self.program.has_ended() {
            return Err(ended(&self.program));
        }
        if self.memory.refused.load(SeqCst) == 0 {
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

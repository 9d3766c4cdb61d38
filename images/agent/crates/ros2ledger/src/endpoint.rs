//! A subscription or publisher of a node, as the ledger has it.

use std::sync::atomic::Ordering::SeqCst;
use std::sync::atomic::{AtomicU8, AtomicU64};
use std::time::Duration;

use crate::layout::{
    EndpointSlot, FLAG_CALLS, FLAG_INTRA, FLAG_LATE, FLAG_MANUAL, KIND_PUBLISHER,
    KIND_SUBSCRIPTION, NAME_BYTES, PHASE_DESTROYED,
};
use crate::{ProcessId, Strength};

/// Which endpoint: a slot, and which use of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct EndpointId {
    pub(crate) slot: usize,
    pub(crate) generation: u32,
}

/// What an endpoint is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// It takes messages.
    Subscription,
    /// It publishes them.
    Publisher,
}

/// How many messages a queue keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum History {
    /// The last ones, as many as the depth.
    KeepLast,
    /// All, as far as the middleware's limits go.
    KeepAll,
    /// As the middleware says, which did not say it: `rmw`'s number.
    Other(u32),
}

/// Whether lost messages are sent again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reliability {
    /// They are.
    Reliable,
    /// They are not.
    BestEffort,
    /// As the middleware says, which did not say it: `rmw`'s number.
    Other(u32),
}

/// Whether late subscribers get earlier messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durability {
    /// They do, as long as the publisher lives.
    TransientLocal,
    /// They don't.
    Volatile,
    /// As the middleware says, which did not say it: `rmw`'s number.
    Other(u32),
}

/// How often an endpoint publishes, and shows that it is there: a publisher promises it, a subscription
/// asks for it, and matches none that promises less. A time that nobody sets is without end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Presence {
    /// The longest time between two messages.
    pub deadline: Option<Duration>,
    /// The longest time without a sign of the publisher.
    pub lease: Option<Duration>,
    /// Whether only the program gives that sign, as by publishing, and not its middleware by itself.
    pub manual: bool,
}

impl Presence {
    /// Nothing is promised or asked for.
    pub const NONE: Presence = Presence { deadline: None, lease: None, manual: false };
}

/// Quality of service, as the node asked for it; what it left to the middleware, as that chose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qos {
    /// How many messages are kept.
    pub history: History,
    /// The queue's length in messages, where `history` is [`History::KeepLast`].
    pub depth: u64,
    /// Whether lost messages are sent again.
    pub reliability: Reliability,
    /// Whether late subscribers get earlier messages.
    pub durability: Durability,
    /// How often messages come, and signs of the publisher.
    pub presence: Presence,
}

/// What an endpoint has done, in messages. None of them goes down.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Taken from the middleware.
    pub taken: u64,
    /// Of these, what publishers of the ledger's reader had published ([`Ledger::own`](crate::Ledger::own)), but
    /// for what its node had taken before by a subscription of the topic that it has destroyed, or else
    /// for what was kept for who comes late.
    pub taken_own: u64,
    /// And those of which the middleware did not say who had published them.
    pub taken_unknown: u64,
    /// What had been taken when last a take found nothing, or a wait that the node was not yet done
    /// with: nothing waited for it in the middleware at [`seen_at`](Counts::seen_at). Both are noted
    /// during [`watch_matches`](crate::Ledger::watch_matches).
    pub rested: Option<u64>,
    /// A moment of `CLOCK_MONOTONIC`, noted during a watch: one at which a subscription was at rest; or
    /// when the last call of a publisher had returned. 0 if there was none.
    pub seen_at: Duration,
    /// Callbacks that began, where rclcpp reports them.
    pub started: u64,
    /// Callbacks that ended.
    pub ended: u64,
    /// Callbacks that began with a message of the same process, which is not taken.
    pub intra_started: u64,
    /// Those that ended.
    pub intra_ended: u64,
    /// Taken by a thread that took again, waited or ended since, without a callback that was
    /// reported: all of them where none is; otherwise those that rclcpp threw away, as it does with
    /// copies of what came within the process.
    pub returned: u64,
    /// Handed to the middleware, which took them.
    pub published: u64,
    /// These, and those that the middleware has been given and has not returned from yet, which
    /// others may have received already: never less than were received, and the same at rest.
    pub offered: u64,
}

impl Counts {
    /// Messages that the node has done with, by the strength of what it reports.
    pub fn done(&self, strength: Strength) -> u64 {
        match strength {
            Strength::Called => self.ended + self.intra_ended + self.returned,
            _ => self.returned + self.intra_ended,
        }
    }

    /// Messages that the node has in hand: taken or handed over in its process, and not done with.
    pub fn in_hand(&self, strength: Strength) -> u64 {
        (self.taken + self.intra_started).saturating_sub(self.done(strength))
    }

    /// Callbacks that run, where rclcpp reports them.
    pub(crate) fn running(&self) -> u64 {
        (self.started + self.intra_started).saturating_sub(self.ended + self.intra_ended)
    }
}

/// A subscription or publisher.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// Which one.
    pub id: EndpointId,
    /// What it is.
    pub kind: Kind,
    /// Whose it is.
    pub process: ProcessId,
    /// The topic's whole name, with its leading slash: 1 to 255 bytes of ASCII.
    pub topic: String,
    /// Its node's whole name, as `/namespace/name`: up to 255 bytes of ASCII. Empty where rmw was
    /// given no node.
    pub node: String,
    /// The GID by which the graph has it, of a publisher over a middleware of which that is known.
    pub gid: Option<[u8; 16]>,
    /// Its quality of service.
    pub qos: Qos,
    /// The thread that last took or called; `None` before.
    pub thread: Option<u32>,
    /// Whether its process has destroyed it, or has become another program.
    pub destroyed: bool,
    /// Whether rclcpp hands it messages of its own process too, which are not taken.
    pub intra_process: bool,
    /// Whether it was listed after one of the reader's publishers had published, and takes the place of no
    /// other that its node had: nothing was sent to it of what is kept for who comes late.
    pub late: bool,
    /// Messages of the reader's publishers count whose stamps are later, in ns since 1970: 0, those of all.
    pub after: i64,
    /// Publishers that a subscription has matched, or subscriptions that a publisher has, as its
    /// middleware says, when its process last began to wait, or within 20 ms of a wait that goes on.
    /// `None` outside of
    /// [`watch_matches`](crate::Ledger::watch_matches), and until its process has looked.
    pub matched: Option<u32>,
    /// What its counts prove; of a publisher, nothing about callbacks.
    pub strength: Strength,
    /// What it has done.
    pub counts: Counts,
}

impl Endpoint {
    /// Whether nothing will be counted any more, for as long as its process runs.
    pub(crate) fn is_at_rest(&self) -> bool {
        let Counts { started, ended, intra_started, intra_ended, .. } = self.counts;
        let calls = (started, intra_started) != (ended, intra_ended);
        self.destroyed && !calls && self.counts.in_hand(self.strength) == 0
    }
}

/// What is wrong with a slot: the offset of the field in it, and a sentence's end.
pub(crate) type Wrong = (usize, String);

/// Reads a slot that is in use. Ends are read before starts and these before takes, so that a
/// node that counts meanwhile is not taken for one that lies.
pub(crate) fn read(
    slot: &EndpointSlot,
    id: EndpointId,
    process: ProcessId,
    phase: u32,
    watch: u32,
) -> Result<Endpoint, Wrong> {
    let flags = slot.flags.load(SeqCst);
    let kind = match slot.kind.load(SeqCst) {
        KIND_SUBSCRIPTION => Kind::Subscription,
        KIND_PUBLISHER => Kind::Publisher,
        other => {
            let at = std::mem::offset_of!(EndpointSlot, kind);
            return Err((at, format!("{other} is no kind of endpoint")));
        }
    };
    let topic = name(slot, &slot.topic, "topic")?;
    if topic.is_empty() {
        let at = std::mem::offset_of!(EndpointSlot, topic);
        return Err((at, "a topic without a name".into()));
    }
    let thread = slot.thread.load(SeqCst);
    let counts = counts(slot)?;
    Ok(Endpoint {
        id,
        kind,
        process,
        topic,
        node: name(slot, &slot.node, "node")?,
        gid: gid(slot),
        qos: qos(slot),
        thread: (thread != 0).then_some(thread),
        destroyed: phase == PHASE_DESTROYED,
        intra_process: flags & FLAG_INTRA != 0,
        late: flags & FLAG_LATE != 0,
        after: slot.own_after.load(SeqCst),
        matched: matched(slot, watch),
        strength: strength(flags, &counts),
        counts,
    })
}

/// Reads a slot again of which all is known that its endpoint never changes.
pub(crate) fn again(slot: &EndpointSlot, known: &Endpoint, phase: u32) -> Result<Endpoint, Wrong> {
    let (flags, counts) = (slot.flags.load(SeqCst), counts(slot)?);
    Ok(Endpoint {
        destroyed: phase == PHASE_DESTROYED,
        intra_process: flags & FLAG_INTRA != 0,
        strength: strength(flags, &counts),
        counts,
        ..known.clone()
    })
}

/// A callback that was added is no callback that ran: a program may take the messages itself. rclcpp does
/// so with copies of what came within the process, which it throws away.
fn strength(flags: u32, counts: &Counts) -> Strength {
    let takes_itself = counts.returned > 0 && counts.started == 0 && flags & FLAG_INTRA == 0;
    match flags & FLAG_CALLS == 0 || takes_itself {
        true => Strength::Taken,
        false => Strength::Called,
    }
}

/// What was seen during this watch; no watch is 0.
fn matched(slot: &EndpointSlot, watch: u32) -> Option<u32> {
    let both = slot.matched.load(SeqCst);
    (watch != 0 && (both >> 32) as u32 == watch).then_some(both as u32)
}

/// The counts alone.
pub(crate) fn counts(slot: &EndpointSlot) -> Result<Counts, Wrong> {
    let ended = slot.ended.load(SeqCst);
    let intra_ended = slot.intra_ended.load(SeqCst);
    let returned = slot.returned.load(SeqCst);
    let started = slot.started.load(SeqCst);
    let intra_started = slot.intra_started.load(SeqCst);
    let rested = slot.rested.load(SeqCst).checked_sub(1);
    let published = slot.published.load(SeqCst);
    // After both and before what was taken: it is noted before the one and before the other.
    let seen_at = Duration::from_nanos(slot.seen_at.load(SeqCst));
    let taken_own = slot.taken_own.load(SeqCst);
    let taken_unknown = slot.taken_unknown.load(SeqCst);
    let taken = slot.taken.load(SeqCst);
    let offered = slot.offered.load(SeqCst);
    // No process counts so far in a lifetime; beyond, sums would not fit.
    let most = [taken, started, intra_started, offered].into_iter().fold(0, u64::max);
    let pairs = [
        (&slot.ended, "ends", ended, "starts", started),
        (&slot.intra_ended, "ends", intra_ended, "starts within the process", intra_started),
        (&slot.returned, "returns", returned, "takes", taken),
        (
            &slot.taken_own,
            "takes by their publishers",
            taken_own.saturating_add(taken_unknown),
            "takes",
            taken,
        ),
        (&slot.rested, "takes before a rest", rested.unwrap_or(0), "takes", taken),
        (&slot.published, "publishes", published, "begun", offered),
        (&slot.taken, "messages", most, "ever", 1 << 60),
    ];
    for (field, what, more, of, less) in pairs {
        if more > less {
            return Err((place(slot, field), format!("{more} {what} of {less} {of}")));
        }
    }
    Ok(Counts {
        taken,
        taken_own,
        taken_unknown,
        rested,
        seen_at,
        started,
        ended,
        intra_started,
        intra_ended,
        returned,
        published,
        offered,
    })
}

/// The name of the slot's topic or node, which `field` has.
fn name(slot: &EndpointSlot, field: &[AtomicU8; NAME_BYTES], of: &str) -> Result<String, Wrong> {
    let mut name = String::with_capacity(NAME_BYTES);
    for byte in field {
        match byte.load(SeqCst) {
            0 => return Ok(name),
            letter if letter.is_ascii_graphic() => name.push(char::from(letter)),
            other => {
                return Err((place(slot, byte), format!("byte {other} in the name of a {of}")));
            }
        }
    }
    Err((place(slot, field) + NAME_BYTES, format!("the name of a {of} does not end")))
}

/// Where a part of a slot is in it.
fn place<T>(slot: &EndpointSlot, part: &T) -> usize {
    std::ptr::from_ref(part).addr() - std::ptr::from_ref(slot).addr()
}

fn gid(slot: &EndpointSlot) -> Option<[u8; 16]> {
    let mut gid = [0; 16];
    for (half, into) in slot.gid.iter().zip(gid.chunks_exact_mut(8)) {
        into.copy_from_slice(&half.load(SeqCst).to_ne_bytes());
    }
    (gid != [0; 16]).then_some(gid)
}

fn qos(slot: &EndpointSlot) -> Qos {
    Qos {
        history: match slot.history.load(SeqCst) {
            1 => History::KeepLast,
            2 => History::KeepAll,
            other => History::Other(other),
        },
        depth: slot.depth.load(SeqCst),
        reliability: match slot.reliability.load(SeqCst) {
            1 => Reliability::Reliable,
            2 => Reliability::BestEffort,
            other => Reliability::Other(other),
        },
        durability: match slot.durability.load(SeqCst) {
            1 => Durability::TransientLocal,
            2 => Durability::Volatile,
            other => Durability::Other(other),
        },
        presence: presence(slot),
    }
}

fn presence(slot: &EndpointSlot) -> Presence {
    let time = |field: &AtomicU64| match field.load(SeqCst) {
        0 => None,
        nanoseconds => Some(Duration::from_nanos(nanoseconds)),
    };
    let manual = slot.flags.load(SeqCst) & FLAG_MANUAL != 0;
    Presence { deadline: time(&slot.deadline), lease: time(&slot.lease), manual }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_takes_without_ever_calling_proves_no_call() {
        let of = |taken, returned, started| {
            let counts = Counts { taken, returned, started, ..Counts::default() };
            [0, FLAG_CALLS, FLAG_CALLS | FLAG_INTRA].map(|flags| strength(flags, &counts))
        };
        let (took, called) = (Strength::Taken, Strength::Called);
        // Before its first message, and with the first one in hand, nothing speaks against it.
        assert_eq!(of(0, 0, 0), [took, called, called]);
        assert_eq!(of(1, 0, 0), [took, called, called]);
        assert_eq!(of(2, 1, 0), [took, took, called]);
        assert_eq!(of(5, 1, 4), [took, called, called]);
    }
}

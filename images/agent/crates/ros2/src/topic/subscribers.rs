//! Who subscribes: those that are there, come, leave and come back.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::Ordering;
use std::sync::{Arc, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_graph::PacedBy;
use bagpipe_ros2ledger::{Endpoint, Kind, LedgerError};
use bagpipe_ros2player::{Durability, History, Reliability};

use super::look::{Look, Owner};
use super::{Looked, Topic};
use crate::absence::LOOK;
use crate::absence::{Absence, BY_THE_CLOCK, RENEWED};
use crate::link::{Link, Totals};
use crate::qos::incompatible;
use crate::seen::is_of_command_line;
use crate::subscriptions::Subscriptions;
use crate::unreported::Unreported;

impl Topic {
    /// Takes in who subscribes now: those that count, and the names of others, where somebody asked
    /// for them.
    pub(crate) fn refresh(
        &self,
        look: &Look,
        uncounted: Option<&[String]>,
    ) -> Result<(), LedgerError> {
        let mut looked = self.looked.lock().unwrap_or_else(PoisonError::into_inner);
        // What goes out from here on is counted by the links.
        let sent = self.sent().totals;
        let mut links = Vec::clone(&self.links());
        // Another thread may have looked later, and been faster: what has gone would be there again.
        if look.number >= looked.look {
            looked.look = look.number;
            self.refresh_counted(&mut looked, &mut links, look, sent)?;
        }
        if let Some(uncounted) = uncounted {
            self.refresh_uncounted(&mut links, uncounted, (look, sent.since(looked.uncounted)));
            looked.uncounted = sent;
        }
        *self.links.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(links);
        self.learn_publishers(&look.endpoints);
        Ok(())
    }

    /// Those that count, where so much was `sent`.
    fn refresh_counted(
        &self,
        looked: &mut Looked,
        links: &mut Vec<Arc<Link>>,
        look: &Look,
        sent: Totals,
    ) -> Result<(), LedgerError> {
        let (now, most) = (Instant::now(), self.most_between_looks());
        let missed = sent.since(looked.counted);
        // Who is listed behind the message that was handed over last has not missed that one.
        let (handed_at, missed_behind) = (looked.handed_at, sent.since(looked.handed));
        (looked.counted, looked.handed) = (sent, sent);
        let mut nodes = look.subscriptions(&self.info.topic);
        // What asks for more than we offer gets nothing, and has nothing to be waited for.
        nodes.retain(|_, subscriptions| {
            subscriptions.retain(|one| self.reaches(one));
            !subscriptions.is_empty()
        });
        self.strangers().retain(|owner, one| {
            one.look(now);
            nodes.contains_key(owner)
        });
        for link in links.iter() {
            let Some(counted) = &link.counted else { continue };
            let owner = (counted.process, link.node.clone());
            let there = nodes.get(&owner).map(Vec::as_slice).unwrap_or_default();
            let others = link.replace(there, self.kept(), &self.means.ledger)?;
            counted.look(now, most, &self.means.ledger)?;
            if there.is_empty() && others && look.running.contains(&owner.0) {
                self.departed().insert(owner, Absence::begin(now));
            }
            if there.is_empty() || (others && self.means.paced_by == PacedBy::Subscribers) {
                link.close();
            }
        }
        self.departed().retain(|owner, absence| {
            !nodes.contains_key(owner)
                && look.running.contains(&owner.0)
                && absence.look(now, most) < RENEWED
        });
        for (owner, subscriptions) in &nodes {
            let behind = subscriptions.iter().all(|one| one.late && one.after > handed_at);
            let missed = if behind { missed_behind } else { missed };
            self.welcome(links, owner, subscriptions, (look, sent, missed))?;
        }
        self.refresh_unmatched(links, sent);
        self.listed.store(look.listed, Ordering::Relaxed);
        Ok(())
    }

    /// A node subscribes: if it is new, or has come back, it has a link from now on, or from when it
    /// knows us. By the clock nobody waits for that once the play has begun: of all that was `sent` by now
    /// it lacks what it did not take, if it was there before, or else of what it may have `missed` since
    /// the last look.
    fn welcome(
        &self,
        links: &mut Vec<Arc<Link>>,
        owner: &Owner,
        subscriptions: &[&Endpoint],
        (look, sent, missed): (&Look, Totals, Totals),
    ) -> Result<(), LedgerError> {
        let known = links.iter().rev().find(|link| link.is_of(owner)).cloned();
        if known.as_ref().is_some_and(|link| link.is_open()) {
            return Ok(());
        }
        let by_the_clock = sent.messages() > 0 && self.means.paced_by == PacedBy::Schedule;
        let is_believed = self.strangers().get(owner).map(Unreported::is_believed);
        let at_once = by_the_clock && is_believed != Some(true);
        if !at_once && !self.knows_us(owner, subscriptions, look, known.is_some()) {
            return Ok(());
        }
        self.strangers().remove(owner);
        let missed = match (by_the_clock, is_believed) {
            (false, _) => Totals::default(),
            // Who is waited for by the clock was there before the first message.
            (true, Some(_)) => sent,
            (true, None) => missed,
        };
        if let Some(link) = known {
            if let Some(counted) = link.counted.as_ref().filter(|_| !by_the_clock) {
                counted.begin(&self.means.ledger)?;
            }
            link.open(missed);
            return Ok(());
        }
        let known = self.means.player.gid(self.publisher).is_some();
        let counted = Subscriptions::new(subscriptions, &self.means.ledger, (known, by_the_clock))?;
        let name = Self::named(links, &owner.1, look);
        links.push(self.link(name, counted, missed));
        Ok(())
    }

    /// Has nodes of the command line go that have left by now: what one misses behind its end is nothing that
    /// the stack lost. Looked at whenever somebody asks for the links, as one may leave at the very end.
    pub(super) fn let_people_go(&self) {
        let is_people = |link: &Link| is_of_command_line(&link.node) && link.process().is_some();
        if !self.links().iter().any(|link| is_people(link)) {
            return;
        }
        // Else who comes meanwhile would have gone by what was read before.
        let _looked = self.looked.lock().unwrap_or_else(PoisonError::into_inner);
        // A ledger that can't be read fails what is asked next.
        let Ok(look) = Look::at(&self.means.ledger) else { return };
        let there = look.subscriptions(&self.info.topic);
        let is_there = |link: &Link| {
            link.process().is_some_and(|of| there.contains_key(&(of, link.node.clone())))
        };
        let mut links = self.links.write().unwrap_or_else(PoisonError::into_inner);
        let kept = links.iter().filter(|link| !is_people(link) || is_there(link)).cloned();
        *links = Arc::new(kept.collect());
    }

    /// Of the time between two looks at most so much counts for who is away. By the clock messages go out
    /// whether anybody looks or not, which is every half a second.
    fn most_between_looks(&self) -> Duration {
        match self.means.paced_by {
            PacedBy::Schedule => BY_THE_CLOCK,
            PacedBy::Subscribers => LOOK,
        }
    }

    /// Messages that are kept for who comes late.
    fn kept(&self) -> u64 {
        match (self.qos.durability, self.qos.reliability, self.qos.history) {
            (Durability::TransientLocal, Reliability::Reliable, History::KeepLast(depth)) => {
                depth.into()
            }
            (Durability::TransientLocal, Reliability::Reliable, History::KeepAll) => u64::MAX,
            (Durability::Volatile, ..) | (_, Reliability::BestEffort, _) => 0,
        }
    }

    /// Whether a subscription may receive what is played.
    pub(crate) fn plays_to(&self, subscription: &Endpoint) -> bool {
        subscription.topic == self.info.topic && self.reaches(subscription)
    }

    /// Whether one of this topic can be given what is offered.
    pub(super) fn reaches(&self, subscription: &Endpoint) -> bool {
        incompatible(&self.qos, &subscription.qos).is_none()
    }

    /// Whether a node is there that does not count, as somebody has found.
    pub(crate) fn is_uncounted(&self, node: &str) -> bool {
        self.links().iter().any(|link| link.is_uncounted() && link.node == node)
    }

    fn refresh_uncounted(
        &self,
        links: &mut Vec<Arc<Link>>,
        names: &[String],
        (look, missed): (&Look, Totals),
    ) {
        let without = |link: &&Arc<Link>| link.is_uncounted();
        // Whom its process has listed meanwhile, or who has gone, before anything was sent to it.
        links.retain(|link| !without(&link) || names.contains(&link.node) || link.sent() > 0);
        for link in links.iter().filter(without).filter(|link| !names.contains(&link.node)) {
            link.close();
        }
        for name in names {
            if !links.iter().filter(without).any(|link| link.node == *name) {
                let name = Self::named(links, name, look);
                links.push(self.link(name, None, missed));
            }
        }
    }

    /// One of some nodes that share their names with others, where more subscribe than can be seen:
    /// `others` are those that do not count.
    pub(crate) fn hidden(
        &self,
        look: &Look,
        namesakes: &BTreeSet<String>,
        others: usize,
    ) -> Option<String> {
        let name = namesakes.first()?;
        // Those of processes that have ended are known for a while.
        let all = look.endpoints.iter().filter(|one| one.kind == Kind::Subscription);
        let all = all.filter(|one| !one.destroyed && one.topic == self.info.topic);
        let unmatched = self.unmatched();
        let there = all.filter(|one| !unmatched.contains(&(one.process, one.node.clone()))).count();
        let known = self.means.player.subscribers(self.publisher).unwrap_or_default();
        (known > (there + others) as u64).then(|| name.clone())
    }

    /// A node's name, with a number that no other of this name has that is there, or may come back.
    fn named(links: &[Arc<Link>], node: &str, look: &Look) -> (String, u32) {
        let runs = |link: &Link| {
            link.counted.as_ref().is_some_and(|one| look.running.contains(&one.process))
        };
        let all = links.iter().filter(|link| link.node == node);
        let taken: BTreeSet<u32> =
            all.filter(|link| link.is_open() || runs(link)).map(|link| link.instance).collect();
        let free = (0..).find(|number| !taken.contains(number)).unwrap_or_default();
        (node.to_owned(), free)
    }

    /// The stack's publishers of the topic, also those that are gone.
    fn publishers<'e>(&self, endpoints: &'e [Endpoint]) -> Vec<&'e Endpoint> {
        let all = endpoints.iter().filter(|one| one.kind == Kind::Publisher);
        all.filter(|one| one.topic == self.info.topic).collect()
    }

    /// Takes in whose messages its subscribers take beside ours.
    pub(crate) fn learn_publishers(&self, endpoints: &[Endpoint]) {
        let (publishers, uncounted) = (self.publishers(endpoints), self.has_uncounted(endpoints));
        self.links().iter().for_each(|link| link.learn(&publishers, uncounted));
    }

    fn link(
        &self,
        name: (String, u32),
        counted: Option<Subscriptions>,
        missed: Totals,
    ) -> Arc<Link> {
        let id = self.means.links.fetch_add(1, Ordering::Relaxed);
        Arc::new(Link::new(id, name, counted, missed))
    }

    pub(super) fn departed(&self) -> MutexGuard<'_, BTreeMap<Owner, Absence>> {
        self.departed.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

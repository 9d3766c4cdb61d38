//! Who has matched us of those that subscribe, and who is waited for until it has.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::Ordering;
use std::sync::{Arc, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_graph::{Cancelled, PacedBy, SendError};
use bagpipe_ros2ledger::{Endpoint, Event, Kind, Ledger, LedgerError};
use bagpipe_ros2player::GraphNode;

use super::Topic;
use super::look::{Look, Owner};
use super::sending::failed;
use crate::absence::RENEWED;
use crate::link::{Link, Totals};
use crate::seen::is_of_command_line;
use crate::unreported::{UNREPORTED, Unreported};

/// How often somebody who waits for new subscriptions looks at them.
const MATCHES: Duration = Duration::from_millis(5);

/// Names of nodes, by what the graph has of each.
#[derive(Default)]
struct Fitting {
    /// Those of which it has what is played.
    fitting: BTreeSet<String>,
    /// Those that several nodes have, of which it does not say which subscribes to what.
    namesakes: BTreeSet<String>,
}

impl Topic {
    /// Before a message goes out: whoever has begun to subscribe since the last one is noticed, and
    /// at the subscribers' pace it gets to know us first, within a bound.
    pub(super) fn meet(&self, cancelled: Cancelled<'_>) -> Result<(), SendError> {
        let ledger = &*self.means.ledger;
        let failed = |error: LedgerError| failed(&error);
        if self.listed.load(Ordering::Relaxed) == ledger.listed() && !self.has_strangers() {
            return Ok(());
        }
        loop {
            self.refresh(&Look::at(ledger).map_err(failed)?, None).map_err(failed)?;
            if !self.has_strangers() {
                return Ok(());
            }
            if !self.means.watching.swap(true, Ordering::Relaxed) {
                ledger.watch_matches(true);
            }
            let changes = [Event::Matched, Event::Listed];
            let never = |_: &Ledger| Ok(false);
            ledger.wait(&changes, &[], Instant::now() + MATCHES, never).map_err(failed)?;
            if cancelled() {
                return Err(SendError::Cancelled);
            }
        }
    }

    /// Whether somebody is to be waited for who subscribes and does not know us yet, or has just left
    /// to subscribe again, and was not waited for in vain. By the clock nobody is.
    pub(super) fn has_strangers(&self) -> bool {
        let is_new = |one: &Unreported| one.lasted() < UNREPORTED + RENEWED;
        self.means.paced_by == PacedBy::Subscribers
            && (self.strangers().values().any(is_new) || !self.departed().is_empty())
    }

    pub(super) fn strangers(&self) -> MutexGuard<'_, BTreeMap<Owner, Unreported>> {
        self.strangers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whose subscriptions have been waited for in vain: they have not matched us.
    pub(super) fn unmatched(&self) -> BTreeSet<Owner> {
        let strangers = self.strangers();
        let waited = strangers.iter().filter(|(_, one)| one.is_believed());
        waited.map(|(owner, _)| owner.clone()).collect()
    }

    /// Whether all subscriptions of a node have matched us, as far as they report: they know more
    /// publishers than there are others, and we know all subscriptions that are there. Of a node
    /// that is `known`, new ones know us from the beginning.
    pub(super) fn knows_us(
        &self,
        owner: &Owner,
        subscriptions: &[&Endpoint],
        look: &Look,
        known: bool,
    ) -> bool {
        let there = look.there(Kind::Subscription, &self.info.topic);
        let there = there.filter(|one| self.reaches(one)).count();
        let uncounted = self.links().iter().filter(|link| link.is_uncounted()).count();
        let there = there + uncounted;
        let knows_more = |one: &Endpoint, all: u32| all as usize > look.counterparts(one);
        let reported = |one: &&Endpoint| one.matched.is_some_and(|all| knows_more(one, all));
        // Either side may know of the other first, and what is published in between never comes.
        let known_to_us = || self.means.player.subscribers(self.publisher).unwrap_or_default();
        let begin = || Unreported::begin(Instant::now());
        let (waited, is_believed) = {
            let mut strangers = self.strangers();
            let one = strangers.entry(owner.clone()).or_insert_with(begin);
            (one.lasted(), one.is_believed())
        };
        let know_us = match known {
            true => waited >= RENEWED,
            false => subscriptions.iter().all(reported),
        };
        // One of the others may be none that it can match, and who computes for long reports nothing new.
        let some = |one: &&Endpoint| one.matched.is_some_and(|known| known > 0);
        let believed = || {
            let Fitting { fitting, namesakes } = self.fitting();
            let may_fit = |node: &String| fitting.contains(node) || namesakes.contains(node);
            let fits = |one: &Endpoint| self.reaches(one) && may_fit(&one.node);
            let fit =
                look.there(Kind::Subscription, &self.info.topic).filter(|one| fits(one)).count();
            let all_match = known_to_us() >= (fit + uncounted) as u64;
            // Which of them asks for what, only they themselves can show.
            match namesakes.contains(&owner.1) {
                true => all_match || subscriptions.iter().all(reported),
                false => {
                    fitting.contains(&owner.1) && (all_match || subscriptions.iter().all(some))
                }
            }
        };
        let knows_all = || {
            let (known, there) = (known_to_us(), there as u64);
            // Of people's nodes some may ask for more than is offered.
            known == there || (known > there && known <= there + self.watched_by_people() as u64)
        };
        let knows = (know_us && knows_all()) || (is_believed && believed());
        if knows {
            // When it subscribes again it is waited for again.
            self.strangers().remove(owner);
        }
        knows
    }

    /// How many nodes of the command line subscribe to it, as `ros2 topic echo` does.
    fn watched_by_people(&self) -> usize {
        let nodes = self.means.player.graph().unwrap_or_default();
        let of_it = |one: &GraphNode| one.subscribes.iter().any(|on| on.0 == self.info.topic);
        nodes.iter().filter(|one| is_of_command_line(&one.name) && of_it(one)).count()
    }

    /// The nodes that subscribe to it as what is played, in our domain.
    fn fitting(&self) -> Fitting {
        let nodes = self.means.player.graph().unwrap_or_default();
        let ours =
            |(topic, of): &(String, String)| *topic == self.info.topic && *of == self.info.datatype;
        let (mut names, mut found) = (BTreeSet::new(), Fitting::default());
        for node in nodes {
            if !names.insert(node.name.clone()) {
                found.namesakes.insert(node.name.clone());
            }
            if node.subscribes.iter().any(ours) {
                found.fitting.insert(node.name);
            }
        }
        found
    }

    /// Those that were waited for in vain, once something was `sent` that they can't have had.
    pub(super) fn refresh_unmatched(&self, links: &mut Vec<Arc<Link>>, sent: Totals) {
        let owners = if sent.messages() > 0 { self.unmatched() } else { BTreeSet::new() };
        let known: BTreeSet<Owner> = links.iter().filter_map(|one| one.unmatched_owner()).collect();
        // Who has matched after all has a line of its own, which lacks what it has not had.
        let counts = |owner: &Owner| links.iter().any(|one| one.is_open() && one.is_of(owner));
        let gone = known.difference(&owners);
        let (matched, left): (BTreeSet<Owner>, BTreeSet<Owner>) = gone.cloned().partition(counts);
        let is_in = |all: &BTreeSet<Owner>, one: &Link| {
            one.unmatched_owner().is_some_and(|owner| all.contains(&owner))
        };
        links.retain(|one| !is_in(&matched, one));
        links.iter().filter(|one| is_in(&left, one)).for_each(|one| one.close());
        for (process, node) in owners.difference(&known) {
            let of_name = links.iter().filter(|link| link.node == *node);
            let instance = of_name.map(|link| link.instance + 1).max().unwrap_or(0);
            let id = self.means.links.fetch_add(1, Ordering::Relaxed);
            let name = (node.clone(), instance);
            links.push(Arc::new(Link::unmatched(id, name, *process, sent)));
        }
    }

    /// Takes in who has been waited for in vain when a message goes out; who looks at the subscribers
    /// waits meanwhile. A look takes in who has matched after all, or is gone.
    pub(super) fn note_unmatched(&self) {
        let links = self.links();
        let has_link = |owner: &Owner| {
            links.iter().any(|one| one.unmatched_owner().is_some_and(|known| known == *owner))
        };
        let is_new = |(owner, one): (&Owner, &Unreported)| one.is_believed() && !has_link(owner);
        if self.strangers().iter().any(is_new) {
            let mut links = Vec::clone(&links);
            let sent = self.sent().totals;
            self.refresh_unmatched(&mut links, sent);
            *self.links.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(links);
        }
    }
}

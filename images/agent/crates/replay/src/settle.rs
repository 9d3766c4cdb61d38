//! Between the stack's appearance and the first input: the connections that the master's
//! knowledge promises come to stand, ours and those between the stack's own nodes.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use bagpipe_graph::{Audit, SystemState};

use crate::ReplayError;
use crate::discovery::{Discovery, LOOK, open_subscribers, others};
use crate::drain::stood_still;
use crate::first_time::FirstTime;
use crate::play::Player;
use crate::startup::Startup;
use crate::time::Time;
use crate::watch::Watch;

/// How long to wait for connections that the master already knows of.
const SETTLE: Duration = Duration::from_secs(2);
/// And for how long at most it waits for who has no processor.
const STARVED: Duration = Duration::from_secs(6);
/// The deadline of a question to a node; roscpp and rospy answer within milliseconds.
const ASK: Duration = Duration::from_secs(1);
/// Who is gone is known to be sooner: its socket refuses, or its master does not know it.
const PROMPT: Duration = Duration::from_millis(500);
/// Where every node publishes, and what no answer is made of.
const LOGS: [&str; 2] = ["/rosout", "/rosout_agg"];

/// Waits until nobody seems to start any more, and the connections stand that the master knows
/// of: several nodes may subscribe to one topic, the recorder must be connected to every
/// publisher, and a node that passes an input on before the next one is connected loses it
/// without a trace. At most 2 s, in which a machine that stands still does not count, and not an
/// error: a registration may be a dead node's, a node may work or hang without end, and one that answers
/// may be moved by something else than topics. Nor does the time in which a node had no processor, up to 6 s
/// of it: what goes out before that one is connected is lost to it.
pub(crate) fn settle(
    discovery: &Discovery<'_>,
    player: &mut Player<'_>,
    first_time: &FirstTime,
    startup: &mut Startup,
    watch: &mut Watch<'_>,
) -> Result<(), ReplayError> {
    let mut deadline = watch.now() + SETTLE;
    let node = discovery.node;
    let mut audit = node.audit(ASK);
    let mut inner = Inner::default();
    let starved_before = startup.starved();
    loop {
        let until = deadline + (startup.starved() - starved_before).min(STARVED);
        if watch.now() >= until {
            return Ok(());
        }
        let state = discovery.look()?;
        if let Some(state) = &state {
            let name = node.name();
            let subscribed = player.advertised().all(|publication| {
                let registered = state.subscribers.get(&publication.info().topic);
                let connected = open_subscribers(publication);
                others(registered, name).all(|node| connected.contains(node))
            });
            if startup.is_over(state)
                && subscribed
                && begun(state, &discovery.expected)
                && discovery.has_every_publisher(state)
                && inner.stand(&promised(state, name), audit.as_mut(), until, watch.time())
            {
                return Ok(());
            }
        }
        let before = watch.now();
        watch.sleep(LOOK)?;
        deadline += stood_still(watch.now() - before);
        first_time.show(state.as_ref(), startup, player, watch)?;
    }
}

/// Whether each node that publishes one of these answers has subscribed to anything but the
/// clock. One that has not is most likely between its two registrations.
fn begun(state: &SystemState, answers: &[String]) -> bool {
    let listening: BTreeSet<&String> = state
        .subscribers
        .iter()
        .filter(|(topic, _)| *topic != "/clock")
        .flat_map(|(_, n)| n)
        .collect();
    let mut answering = answers.iter().filter_map(|topic| state.publishers.get(topic)).flatten();
    answering.all(|node| listening.contains(node))
}

/// A topic and one of its subscribers.
type Link = (String, String);

/// The connections between other nodes than `ourselves` that the master's lists promise, by
/// publisher. What a node sends to itself never leaves it.
fn promised(state: &SystemState, ourselves: &str) -> BTreeMap<String, BTreeSet<Link>> {
    let mut promised: BTreeMap<String, BTreeSet<Link>> = BTreeMap::new();
    let topics = state.publishers.iter().filter(|(topic, _)| !LOGS.contains(&topic.as_str()));
    for (topic, publishers) in topics {
        for publisher in others(Some(publishers), ourselves) {
            let subscribers = others(state.subscribers.get(topic), ourselves);
            let links = subscribers.filter(|node| *node != publisher);
            let links: Vec<Link> = links.map(|node| (topic.clone(), node.clone())).collect();
            if !links.is_empty() {
                promised.entry(publisher.clone()).or_default().extend(links);
            }
        }
    }
    promised
}

/// What the stack's nodes have reported about the connections between them.
#[derive(Default)]
struct Inner {
    standing: BTreeMap<String, BTreeSet<Link>>,
    /// Nodes that nobody answers for: they are gone.
    mute: BTreeSet<String>,
}

impl Inner {
    /// Whether all that is promised stands, as far as the publishers report.
    fn stand(
        &mut self,
        promised: &BTreeMap<String, BTreeSet<Link>>,
        audit: &mut dyn Audit,
        deadline: Instant,
        time: &Time,
    ) -> bool {
        let mut all_answer = true;
        for (node, links) in promised {
            if self.holds(node, links) {
                continue;
            }
            let asked = time.now();
            if asked >= deadline {
                return false;
            }
            match audit.subscribers(node) {
                Ok(standing) => _ = self.standing.insert(node.clone(), standing),
                // It computes, or has no processor, and is asked again.
                Err(_) if time.now() - asked >= PROMPT => all_answer = false,
                Err(_) => _ = self.mute.insert(node.clone()),
            }
            if self.standing.contains_key(node) && !self.holds(node, links) {
                return false;
            }
        }
        all_answer
    }

    fn holds(&self, node: &str, links: &BTreeSet<Link>) -> bool {
        self.mute.contains(node)
            || self.standing.get(node).is_some_and(|standing| links.is_subset(standing))
    }
}

#[cfg(test)]
mod tests {
    use bagpipe_graph::{GraphError, Received};

    use super::*;
    use crate::time::ByHand;

    fn named(topics: &[(&str, &[&str])]) -> BTreeMap<String, Vec<String>> {
        let nodes = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        topics.iter().map(|(topic, names)| ((*topic).to_owned(), nodes(names))).collect()
    }

    #[test]
    fn a_node_that_answers_has_begun_once_it_listens_to_more_than_the_clock() {
        let seen = |subscribers: &[(&str, &[&str])]| SystemState {
            publishers: named(&[("/a", &["/quick"]), ("/b", &["/slow"]), ("/c", &["/other"])]),
            subscribers: named(subscribers),
        };
        let answers = ["/a".to_owned(), "/b".to_owned()];
        let clock: (&str, &[&str]) = ("/clock", &["/quick", "/slow"]);
        assert!(!begun(&seen(&[clock, ("/in", &["/quick"])]), &answers));
        assert!(begun(&seen(&[clock, ("/in", &["/quick", "/slow"])]), &answers));
        assert!(begun(&seen(&[clock, ("/in", &["/quick"])]), &answers[..1]));
    }

    #[test]
    fn connections_of_others_are_promised_by_topic_and_ours_and_the_logs_are_not() {
        let state = SystemState {
            publishers: named(&[
                ("/in", &["/us"]),
                ("/mid", &["/first", "/both"]),
                ("/out", &["/second"]),
                ("/rosout", &["/first", "/second"]),
            ]),
            subscribers: named(&[
                ("/in", &["/first"]),
                ("/mid", &["/both", "/second", "/us"]),
                ("/out", &["/us"]),
                ("/rosout", &["/rosout"]),
            ]),
        };
        let link = |node: &str| ("/mid".to_owned(), node.to_owned());
        let expected = BTreeMap::from([
            ("/first".to_owned(), BTreeSet::from([link("/both"), link("/second")])),
            ("/both".to_owned(), BTreeSet::from([link("/second")])),
        ]);
        assert_eq!(promised(&state, "/us"), expected);
    }

    /// Answers each question after so long with what stands, or not at all.
    struct Answers<'a> {
        time: &'a Time,
        script: Vec<(Duration, Option<Link>)>,
    }

    impl Audit for Answers<'_> {
        fn ask(
            &mut self,
            _: &str,
            _: &BTreeMap<String, Vec<u64>>,
        ) -> Result<BTreeMap<(String, u64), Received>, GraphError> {
            unreachable!("nobody asks what was received")
        }

        fn pid(&mut self, _: &str) -> Result<i32, GraphError> {
            unreachable!("nobody asks for processes")
        }

        fn subscribers(&mut self, _: &str) -> Result<BTreeSet<Link>, GraphError> {
            let (after, answer) = self.script.remove(0);
            self.time.sleep(after);
            let source = "nobody answers".into();
            let silent = GraphError { reason: "RosMasterFailed", what: "asking", source };
            answer.map(|link| BTreeSet::from([link])).ok_or(silent)
        }
    }

    /// What each look at a node's connection finds, with these answers one after the other, and how many of them
    /// were asked for.
    fn looks(script: &[(u64, bool)]) -> (Vec<bool>, usize) {
        let time = Time::ByHand(ByHand::new());
        let link = || ("/mid".to_owned(), "/second".to_owned());
        let script = script
            .iter()
            .map(|(ms, answers)| (Duration::from_millis(*ms), answers.then(link)))
            .collect::<Vec<_>>();
        let all = script.len();
        let mut answers = Answers { time: &time, script };
        let promised = BTreeMap::from([("/first".to_owned(), BTreeSet::from([link()]))]);
        let (mut inner, deadline) = (Inner::default(), time.now() + SETTLE);
        let mut look = || inner.stand(&promised, &mut answers, deadline, &time);
        let looks = vec![look(), look(), look()];
        (looks, all - answers.script.len())
    }

    #[test]
    fn who_is_too_busy_to_answer_is_asked_again_and_who_is_gone_is_not() {
        assert_eq!(looks(&[(3, true)]), (vec![true; 3], 1));
        assert_eq!(looks(&[(3, false)]), (vec![true; 3], 1));
        assert_eq!(looks(&[(1000, false), (3, true)]), (vec![false, true, true], 2));
        // Not longer than until the deadline.
        assert_eq!(looks(&[(1000, false), (1000, false)]), (vec![false; 3], 2));
    }
}

#![allow(clippy::unwrap_used)]

use std::collections::HashSet;

use super::*;
use crate::{Durability, EndpointId, Presence, Qos, Strength};

const ALIVE: u32 = 1;
const DEAD: u32 = 2;

/// All run, and nobody sleeps.
const AWAKE: Kernel<'_> = Kernel { runs: &|_| true, sleeps: &|_| false };

fn process(pid: u32) -> ProcessId {
    ProcessId { pid, start: 7, entry: pid as usize }
}

/// An endpoint of process 1 with a queue of 10, reliable.
fn endpoint(slot: usize, kind: Kind, topic: &str, counts: Counts) -> Endpoint {
    let qos = Qos {
        history: History::KeepLast,
        depth: 10,
        reliability: Reliability::Reliable,
        durability: Durability::Volatile,
        presence: Presence::NONE,
    };
    Endpoint {
        id: EndpointId { slot, generation: 1 },
        kind,
        process: process(ALIVE),
        topic: topic.into(),
        node: format!("/{}", topic.trim_start_matches('/')),
        gid: None,
        qos,
        thread: None,
        destroyed: false,
        intra_process: false,
        late: false,
        after: 0,
        matched: None,
        strength: Strength::Called,
        counts,
    }
}

/// In slot 0: has published so many on /a.
fn publisher(published: u64) -> Endpoint {
    endpoint(0, Kind::Publisher, "/a", Counts { published, ..Counts::default() })
}

/// In slot 1: has taken so many of /a, and so many of its callbacks ended.
fn subscription(taken: u64, ended: u64) -> Endpoint {
    let counts = Counts { taken, started: ended, ended, ..Counts::default() };
    endpoint(1, Kind::Subscription, "/a", counts)
}

#[derive(Debug, PartialEq, Eq)]
enum Answer {
    Still,
    /// In hand, and not taken, of each.
    Working(Vec<(u64, u64)>),
    /// Missing, and why, of each.
    Unknown(Vec<(u64, Why)>),
}

fn answer(before: &[Endpoint], now: Vec<Endpoint>, sent: &[(&str, u64)]) -> Answer {
    asked(before, Look { endpoints: now, ..Look::default() }, sent)
}

fn asked(before: &[Endpoint], look: Look, sent: &[(&str, u64)]) -> Answer {
    let since = Mark { endpoints: before.to_vec() };
    let (busy, doubts) = decide(&since, &look, sent, &mut |of| of.pid != DEAD);
    if !busy.is_empty() {
        return Answer::Working(busy.iter().map(|one| (one.in_hand, one.untaken)).collect());
    }
    if !doubts.is_empty() {
        return Answer::Unknown(doubts.iter().map(|one| (one.missing, one.why)).collect());
    }
    Answer::Still
}

fn working(in_hand: u64, untaken: u64) -> Answer {
    Answer::Working(vec![(in_hand, untaken)])
}

fn unknown(missing: u64, why: Why) -> Answer {
    Answer::Unknown(vec![(missing, why)])
}

/// The endpoint, changed.
fn with(mut of: Endpoint, change: impl FnOnce(&mut Endpoint)) -> Endpoint {
    change(&mut of);
    of
}

#[test]
fn what_is_taken_and_called_is_still_and_what_is_not_is_work() {
    // Published, taken and ended, of which 5, 3 and 3 were before the mark: two never came.
    let before = [publisher(5), subscription(3, 3)];
    for (published, taken, ended, expected) in [
        (5, 3, 3, Answer::Still),
        (6, 3, 3, working(0, 1)),
        (6, 4, 3, working(1, 0)),
        (8, 4, 3, working(1, 2)),
        (6, 4, 4, Answer::Still),
        (15, 13, 13, Answer::Still),
        (15, 3, 3, working(0, 10)),
        (5, 4, 3, working(1, 0)),
        (5, 4, 4, unknown(0, Why::Uncounted)),
    ] {
        let now = vec![publisher(published), subscription(taken, ended)];
        assert_eq!(answer(&before, now, &[]), expected, "{published} {taken} {ended}");
    }
}

#[test]
fn more_than_the_shortest_queue_keeps_may_be_overwritten_and_only_if_it_is_missing() {
    let before = [publisher(0), subscription(0, 0)];
    let depth = |of: Endpoint, depth| with(of, |one| one.qos.depth = depth);
    let history = |of: Endpoint, history| with(of, |one| one.qos.history = history);
    for (now, expected) in [
        ([publisher(10), subscription(0, 0)], working(0, 10)),
        ([publisher(11), subscription(0, 0)], unknown(11, Why::Overwritten { depth: 10 })),
        ([publisher(11), subscription(10, 10)], unknown(1, Why::Overwritten { depth: 10 })),
        ([publisher(11), subscription(11, 11)], Answer::Still),
        ([publisher(2), depth(subscription(1, 1), 1)], unknown(1, Why::Overwritten { depth: 1 })),
        ([depth(publisher(2), 1), subscription(1, 1)], unknown(1, Why::Overwritten { depth: 1 })),
        (
            [publisher(11), history(subscription(0, 0), History::KeepAll)],
            unknown(11, Why::Overwritten { depth: 10 }),
        ),
        (
            [
                history(publisher(11), History::KeepAll),
                history(subscription(0, 0), History::KeepAll),
            ],
            working(0, 11),
        ),
        (
            [publisher(1), history(subscription(0, 0), History::Other(4))],
            unknown(1, Why::Overwritten { depth: 0 }),
        ),
    ] {
        assert_eq!(answer(&before, now.to_vec(), &[]), expected, "{now:?}");
    }
}

#[test]
fn what_may_never_come_is_a_doubt_as_long_as_it_has_not_come() {
    let before = [publisher(0), subscription(0, 0)];
    let best_effort = |of| with(of, |one| one.qos.reliability = Reliability::BestEffort);
    let destroyed = |of| with(of, |one| one.destroyed = true);
    let dead = |of| with(of, |one| one.process = process(DEAD));
    let later = |of| with(of, |one| one.id.generation = 2);
    for (from, to, why) in [
        (best_effort(publisher(1)), subscription(0, 0), Why::BestEffort),
        (publisher(1), best_effort(subscription(0, 0)), Why::BestEffort),
        (destroyed(publisher(1)), subscription(0, 0), Why::PublisherGone),
        (dead(publisher(1)), subscription(0, 0), Why::PublisherGone),
        (publisher(1), later(subscription(0, 0)), Why::Late),
    ] {
        let now = vec![from.clone(), to.clone()];
        assert_eq!(answer(&before, now, &[]), unknown(1, why), "{from:?} {to:?}");
        let come = with(to, |one| one.counts = subscription(1, 1).counts);
        assert_eq!(answer(&before, vec![from, come], &[]), Answer::Still);
    }
    // Durable messages of before the mark, which a new subscription has as well.
    assert_eq!(
        answer(&before, vec![publisher(0), later(subscription(1, 1))], &[]),
        unknown(0, Why::Late)
    );
    // The one of the mark was retired, and may have published before.
    let now = vec![later(publisher(1)), subscription(0, 0)];
    assert_eq!(answer(&before, now, &[]), unknown(1, Why::Retired));
    assert_eq!(answer(&before, vec![subscription(0, 0)], &[]), unknown(0, Why::Retired));
    // One that appeared, beside that of the mark.
    let new = with(publisher(1), |one| one.id.slot = 2);
    let now = vec![publisher(0), subscription(0, 0), new];
    assert_eq!(answer(&before, now, &[]), unknown(1, Why::Late));
}

#[test]
fn who_can_not_take_any_more_is_not_waited_for() {
    let before = [publisher(0), subscription(0, 0)];
    let destroyed = |of| with(of, |one| one.destroyed = true);
    let dead = |of| with(of, |one| one.process = process(DEAD));
    for (to, expected) in [
        (destroyed(subscription(0, 0)), Answer::Still),
        // Destroyed in its own callback, which runs still.
        (destroyed(subscription(1, 0)), working(1, 0)),
        (dead(subscription(0, 0)), Answer::Still),
        (dead(subscription(1, 0)), Answer::Still),
        (dead(subscription(2, 2)), Answer::Still),
    ] {
        assert_eq!(answer(&before, vec![publisher(1), to.clone()], &[]), expected, "{to:?}");
    }
}

#[test]
fn what_a_player_sent_counts_as_what_nodes_published() {
    let before = [publisher(0), subscription(4, 4)];
    for (sent, published, taken, expected) in [
        (1, 0, 4, working(0, 1)),
        (1, 0, 5, Answer::Still),
        (2, 3, 8, working(0, 1)),
        (2, 3, 9, Answer::Still),
        (2, 3, 10, unknown(0, Why::Uncounted)),
        (11, 0, 14, unknown(1, Why::Overwritten { depth: 10 })),
    ] {
        let now = vec![publisher(published), subscription(taken, taken)];
        assert_eq!(answer(&before, now, &[("/a", sent)]), expected, "{sent} {published} {taken}");
    }
    // On a topic that nobody subscribes to it is nobody's work.
    let now = before.to_vec();
    assert_eq!(answer(&before, now, &[("/b", 3)]), Answer::Still);
}

#[test]
fn each_strength_has_its_own_end_and_what_rclcpp_threw_away_is_done() {
    let before = [publisher(0), subscription(0, 0)];
    let taken = |returned| {
        with(subscription(1, 0), |one| {
            one.strength = Strength::Taken;
            one.counts.returned = returned;
        })
    };
    assert_eq!(answer(&before, vec![publisher(1), taken(0)], &[]), working(1, 0));
    assert_eq!(answer(&before, vec![publisher(1), taken(1)], &[]), Answer::Still);
    let called = with(taken(1), |one| one.strength = Strength::Called);
    assert_eq!(answer(&before, vec![publisher(1), called], &[]), Answer::Still);
}

#[test]
fn within_a_process_something_may_wait_while_a_thread_of_it_is_awake() {
    let intra = |taken| with(subscription(taken, taken), |one| one.intra_process = true);
    let before = [publisher(0), intra(0)];
    let of = |now: &[Endpoint]| {
        let look = Look { endpoints: now.to_vec(), ..Look::default() };
        let doubts = |busy: &[Busy], asleep| within(&look, busy, &mut |_| asleep).len();
        let (busy, _) = decide(&Mark { endpoints: before.to_vec() }, &look, &[], &mut |_| true);
        (answer(&before, now.to_vec(), &[]), doubts(&busy, false), doubts(&busy, true))
    };
    assert_eq!(of(&before), (Answer::Still, 1, 0));
    // What one of another process publishes is taken as any other.
    let elsewhere = with(publisher(1), |one| one.process = process(3));
    assert_eq!(of(&[elsewhere.clone(), intra(0)]), (working(0, 1), 0, 0));
    assert_eq!(of(&[elsewhere, intra(1)]), (Answer::Still, 0, 0));
    let destroyed = with(publisher(0), |one| one.destroyed = true);
    assert_eq!(of(&[destroyed, intra(0)]), (Answer::Still, 1, 0));
    assert_eq!(of(&[publisher(0), with(intra(0), |one| one.destroyed = true)]).1, 0);
    // A copy that comes through the middleware as well, and one that may be lost there.
    assert_eq!(of(&[publisher(1), intra(0)]), (working(0, 1), 1, 0));
    let weak = with(intra(0), |one| one.qos.reliability = Reliability::BestEffort);
    assert_eq!(of(&[publisher(1), weak]).0, unknown(1, Why::BestEffort));
    // Of several threads that which threw its copy away shows it with the next message only.
    let counts = Counts { taken: 1, intra_started: 1, intra_ended: 1, ..Counts::default() };
    let copied = with(intra(0), |one| one.counts = counts);
    assert_eq!(of(&[publisher(1), copied.clone()]), (Answer::Still, 1, 0));
    let called = with(copied.clone(), |one| one.counts.started = 1);
    assert_eq!(of(&[publisher(1), called]).0, working(1, 0));
    let elsewhere = with(publisher(1), |one| one.process = process(3));
    assert_eq!(of(&[elsewhere, copied]), (working(1, 0), 0, 0));
    // A callback with such a message runs, in which its process may hand over more: that is work.
    let runs = with(intra(0), |one| one.counts.intra_started = 1);
    assert_eq!(of(&[publisher(0), runs]), (working(1, 0), 0, 0));
}

/// One that is handed messages within its process, and was asleep at these questions.
fn settled_within(looks: &[[u64; 2]], asleep: &[bool]) -> (Quiet, usize, usize) {
    let (mut read, asked) = (0, std::cell::Cell::new(0));
    let of = |started: u64, ended: u64| {
        let counts = Counts { intra_started: started, intra_ended: ended, ..Counts::default() };
        let intra = endpoint(1, Kind::Subscription, "/a", counts);
        vec![publisher(0), with(intra, |one| one.intra_process = true)]
    };
    let before = Mark { endpoints: of(0, 0) };
    let look = || {
        let [started, ended] = looks[read.min(looks.len() - 1)];
        read += 1;
        Ok(Look { endpoints: of(started, ended), ..Look::default() })
    };
    let sleeps = |_: ProcessId| {
        let at = asked.replace(asked.get() + 1);
        asleep[at.min(asleep.len() - 1)]
    };
    let answer = settle(&before, &[], look, &Kernel { runs: &|_| true, sleeps: &sleeps }).unwrap();
    (answer, read, asked.get())
}

#[test]
fn what_may_wait_within_a_process_does_not_if_it_sleeps_between_two_reads() {
    let (answer, reads, asked) = settled_within(&[[0, 0]], &[true]);
    assert!(matches!(answer, Quiet::Still(_)));
    assert_eq!((reads, asked), (2, 1));
    // It has called something by the second read, and published who knows what.
    let (answer, reads, asked) = settled_within(&[[0, 0], [1, 1]], &[true, false]);
    assert!(matches!(answer, Quiet::Unknown(doubts) if doubts[0].why == Why::IntraProcess));
    assert_eq!((reads, asked), (3, 2));
    let (answer, ..) = settled_within(&[[0, 0], [1, 0]], &[true]);
    assert!(matches!(answer, Quiet::Working(busy, _) if busy[0].in_hand == 1));
    let (answer, ..) = settled_within(&[[0, 0]], &[false]);
    assert!(matches!(answer, Quiet::Unknown(doubts) if doubts[0].missing == 0));
}

#[test]
fn counts_that_are_too_many_for_a_sum_are_no_panic() {
    let most = |slot| with(publisher(1 << 60), |one| one.id.slot = slot);
    let mut now = vec![subscription(0, 0)];
    now.extend((2..40).map(most));
    let before = now.iter().map(|one| with(one.clone(), |one| one.counts = Counts::default()));
    let before: Vec<_> = before.collect();
    let expected = unknown(u64::MAX, Why::Overwritten { depth: 10 });
    assert_eq!(answer(&before, now, &[("/a", u64::MAX), ("/a", 7)]), expected);
}

#[test]
fn timers_are_work_and_what_found_no_room_is_a_doubt() {
    let before = [publisher(0), subscription(0, 0)];
    let look = |others: &[(u32, u64, u64)], unlisted| Look {
        endpoints: before.to_vec(),
        others: others
            .iter()
            .map(|(pid, ended, started)| (process(*pid), *ended, *started))
            .collect(),
        unlisted,
    };
    for (others, unlisted, expected) in [
        (vec![(ALIVE, 3, 3)], false, Answer::Still),
        (vec![(ALIVE, 3, 5), (3, 0, 0)], false, working(2, 0)),
        (vec![(DEAD, 3, 5)], false, Answer::Still),
        (vec![(ALIVE, 3, 3)], true, unknown(0, Why::Unlisted)),
        (vec![(ALIVE, 3, 4)], true, working(1, 0)),
    ] {
        assert_eq!(asked(&before, look(&others, unlisted), &[]), expected, "{others:?}");
    }
}

/// A -> B -> C: what B publishes is C's work, in every order in which it can be seen.
#[test]
fn a_chain_is_never_still_before_its_end() {
    let of = |counts: [u64; 5]| {
        let [a_published, b_taken, b_ended, b_published, c_taken] = counts;
        let mut all = vec![publisher(a_published), subscription(b_taken, b_ended)];
        let counts = Counts { published: b_published, ..Counts::default() };
        all.push(endpoint(2, Kind::Publisher, "/b", counts));
        let counts =
            Counts { taken: c_taken, started: c_taken, ended: c_taken, ..Counts::default() };
        all.push(endpoint(3, Kind::Subscription, "/b", counts));
        all
    };
    let before = of([0; 5]);
    let steps = [[1, 0, 0, 0, 0], [1, 1, 0, 0, 0], [1, 1, 0, 1, 0], [1, 1, 1, 1, 0]];
    let mut seen = HashSet::new();
    for counts in steps {
        let Answer::Working(busy) = answer(&before, of(counts), &[]) else { panic!("{counts:?}") };
        seen.extend(busy);
    }
    assert_eq!(seen, HashSet::from([(0, 1), (1, 0)]));
    assert_eq!(answer(&before, of([1; 5]), &[]), Answer::Still);
}

#[test]
fn what_has_come_is_of_this_node_and_this_topic_and_later_than_the_mark() {
    let mark = |endpoints: &[Endpoint]| Mark { endpoints: endpoints.to_vec() };
    let before = mark(&[publisher(0), subscription(2, 2)]);
    let intra = with(subscription(2, 2), |one| one.counts.intra_started = 1);
    for (now, has) in [
        (vec![publisher(5), subscription(2, 2)], false),
        (vec![publisher(5), subscription(3, 2)], true),
        (vec![publisher(0), intra], true),
        // Another one in its slot, which has taken something.
        (vec![with(subscription(1, 1), |one| one.id.generation = 2)], true),
        (vec![], false),
    ] {
        assert_eq!(mark(&now).has_come_since(&before, "/a", "/a"), has, "{now:?}");
        assert!(!mark(&now).has_come_since(&before, "/b", "/a"));
        assert!(!mark(&now).has_come_since(&before, "/a", "/b"));
    }
}

fn settled(looks: &[[u64; 3]]) -> (Quiet, usize) {
    let mut read = 0;
    let look = || {
        let [published, taken, ended] = looks[read.min(looks.len() - 1)];
        read += 1;
        let endpoints = vec![publisher(published), subscription(taken, ended)];
        Ok(Look { endpoints, ..Look::default() })
    };
    let before = Mark { endpoints: vec![publisher(0), subscription(0, 0)] };
    let answer = settle(&before, &[], look, &AWAKE).unwrap();
    (answer, read)
}

#[test]
fn nothing_is_still_that_was_not_so_in_two_reads() {
    let (answer, reads) = settled(&[[1, 1, 1]]);
    assert!(matches!(answer, Quiet::Still(mark) if mark.endpoints[0].counts.published == 1));
    assert_eq!(reads, 2);
    // The first read had the publisher before its message and the subscription after the one before.
    let (answer, reads) = settled(&[[1, 1, 1], [2, 1, 1]]);
    assert!(matches!(answer, Quiet::Working(busy, _) if busy[0].untaken == 1));
    assert_eq!(reads, 2);
    // The other way round: more is taken than published, until that is read too.
    let (answer, reads) = settled(&[[1, 2, 2], [2, 2, 2]]);
    assert!(matches!(answer, Quiet::Still(_)));
    assert_eq!(reads, 3);
    let (answer, _) = settled(&[[1, 2, 2]]);
    assert!(matches!(answer, Quiet::Unknown(doubts) if doubts[0].why == Why::Uncounted));
    // Who counts at each read is working, however often it is read.
    let looks: Vec<_> = (1..99).map(|count| [count, count, count]).collect();
    let (answer, reads) = settled(&looks);
    assert!(matches!(answer, Quiet::Working(busy, _) if busy.len() == 2 && busy[0].untaken == 0));
    assert_eq!(reads, 1 + READS);
}

/// One whose callback runs on, beside one that may lose what it has not taken.
fn beside_work(looks: &[[u64; 2]]) -> (Quiet, usize) {
    let mut read = 0;
    let of = |published: u64, taken: u64| {
        let counts = Counts { taken, started: taken, ended: taken, ..Counts::default() };
        let weak = with(endpoint(2, Kind::Subscription, "/a", counts), |one| {
            one.qos.reliability = Reliability::BestEffort;
        });
        let runs = Counts { taken: 1, started: 1, ..Counts::default() };
        vec![publisher(published), endpoint(1, Kind::Subscription, "/b", runs), weak]
    };
    let before = Mark { endpoints: of(0, 0) };
    let look = || {
        let [published, taken] = looks[read.min(looks.len() - 1)];
        read += 1;
        Ok(Look { endpoints: of(published, taken), ..Look::default() })
    };
    let answer = settle(&before, &[], look, &AWAKE).unwrap();
    (answer, read)
}

#[test]
fn what_runs_hides_no_doubt_and_a_doubt_is_the_same_in_two_reads() {
    let Quiet::Working(busy, doubts) = beside_work(&[[1, 0]]).0 else { panic!() };
    assert_eq!((busy.len(), busy[0].in_hand), (1, 1));
    let found: Vec<_> = doubts.iter().map(|one| (one.missing, one.why)).collect();
    assert_eq!(found, [(1, Why::BestEffort)]);
    // The first read had the publisher before its message and the subscription with it.
    let (Quiet::Working(_, doubts), reads) = beside_work(&[[1, 2], [2, 2]]) else { panic!() };
    assert_eq!((doubts, reads), (vec![], 2));
    // Who counts at each read makes nobody else's work end.
    let looks: Vec<_> = (1..99).map(|count| [count + 1, count]).collect();
    let (Quiet::Working(busy, doubts), reads) = beside_work(&looks) else { panic!() };
    assert!(busy.iter().any(|one| one.topic.as_deref() == Some("/b") && one.in_hand == 1));
    assert_eq!((busy.len(), doubts, reads), (3, vec![], 1 + READS));
    // Without a doubt nobody reads again.
    let (Quiet::Working(_, doubts), reads) = beside_work(&[[1, 1]]) else { panic!() };
    assert_eq!((doubts, reads), (vec![], 1));
}

type Change = fn(&mut Endpoint);

#[test]
fn what_an_idle_node_counts_is_no_difference() {
    let look = |change: Change| Look::new(vec![with(subscription(1, 1), change)], vec![], false);
    let changes: [(Change, bool); 5] = [
        (|one| one.counts.rested = Some(9), true),
        (|one| one.thread = Some(7), true),
        (|one| one.matched = Some(1), true),
        (|one| one.counts.returned = 1, false),
        (|one| one.destroyed = true, false),
    ];
    for (at, (change, same)) in changes.into_iter().enumerate() {
        assert_eq!(look(change) == look(|_| ()), same, "{at}");
    }
}

#[test]
fn who_counts_between_two_reads_is_named() {
    let look = |taken, ended| Look {
        endpoints: vec![publisher(1), subscription(taken, taken)],
        others: vec![(process(ALIVE), ended, ended)],
        unlisted: false,
    };
    assert_eq!(differing(&look(1, 1), &look(1, 1)), []);
    let changed = differing(&look(1, 1), &look(2, 2));
    let named: Vec<_> = changed.iter().map(|one| (one.topic.as_deref(), one.in_hand)).collect();
    assert_eq!(named, [(Some("/a"), 0), (None, 0)]);
}

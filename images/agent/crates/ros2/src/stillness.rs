//! Waiting until the stack has worked off what it was sent, as far as its nodes count.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::Doubt as Doubted;
use bagpipe_ros2ledger::{
    Busy, Event, Ledger, LedgerError, Mark, ProcessId, Quiet, Strength, Waited, Why,
};

mod doubt;
mod stuck;

use doubt::{Doubt, InVain};
use stuck::{Stuck, Whose};

/// How long something is waited for that may never come, while everybody sleeps: a message that a
/// queue has overwritten, or that a subscription does not match. A node that gets no processor for a
/// while, as where a container's share is used up, is none of these.
const DOUBTFUL: Duration = Duration::from_secs(1);
/// How often that is halved for a node and a topic where something never came, and how often in a row,
/// until nothing more is waited for.
const HALVED: u32 = 6;
const IN_A_ROW: u32 = 8;
/// How long the end of a callback that may never show is waited for, while everybody sleeps: of a node
/// without tracepoints that has several threads, the last ones come back with the next message only.
const COMES_BACK: Duration = Duration::from_millis(100);
/// How often, and after how long, it is asked again whether a thread sleeps that has come back from a callback.
const ASKED: u32 = 10;
const SOON: Duration = Duration::from_micros(200);
/// What moves a stack on.
const EVENTS: [Event; 3] = [Event::Taken, Event::Ended, Event::Published];

/// A stack's moments of rest.
#[derive(Default)]
pub(crate) struct Stillness {
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    mark: Option<Mark>,
    /// Messages of ours on each topic by then, in the order of the topics.
    sent: Vec<u64>,
    /// Node and topic of what did not come.
    lacks: BTreeMap<Whose, Lacks>,
    stuck: Stuck,
}

/// How often something did not come to a node on a topic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Lacks {
    times: u32,
    in_a_row: u32,
    /// Whether something is missing for certain, and not in doubt alone since one of both ends was new.
    certain: bool,
    /// Whether it was not seen what waits within its process.
    unseen: bool,
}

impl Lacks {
    /// How long something more is waited for, of what is waited for at first.
    fn patience(self, first: Duration) -> Duration {
        match self.in_a_row >= IN_A_ROW {
            true => Duration::ZERO,
            false => first / (1 << self.times.saturating_sub(1).min(HALVED)),
        }
    }

    /// Takes in that something did not come, where an end of it was new (`late`) or not.
    fn add(&mut self, late: bool) {
        self.times += 1;
        self.in_a_row += 1;
        self.certain |= !late || self.in_a_row > 1;
    }

    /// Takes in that it was not seen whether something is to come: once, a thread may have been awake by chance.
    fn add_unseen(&mut self) {
        self.times += 1;
        self.in_a_row += 1;
        self.unseen |= self.in_a_row > 1;
    }
}

/// What is left to be done at a look.
#[derive(Default)]
struct Rest {
    /// All of it.
    left: BTreeSet<Whose>,
    /// Of that, whose work it is: the rest is in doubt.
    busy: BTreeSet<Whose>,
    /// Of that, what was taken already.
    called: BTreeSet<Whose>,
    /// And what may have ended unseen: all was taken, by a node that shows no end, in a process of
    /// several threads.
    hidden: BTreeSet<Whose>,
    /// What is in doubt since one of both ends is new.
    late: BTreeSet<Whose>,
    /// What may wait within a process, and nothing that is known to lack.
    within: BTreeSet<Whose>,
}

impl Rest {
    fn of(ledger: &Ledger, busy: &[Busy], doubts: &[Doubted]) -> Result<Rest, LedgerError> {
        let taken = |one: &&Busy| one.in_hand > 0 || one.untaken == 0;
        let silent = |one: &&Busy| one.strength != Strength::Called && one.untaken == 0;
        let several: BTreeSet<ProcessId> = match busy.iter().any(|one| silent(&one)) {
            true => ledger
                .processes()?
                .iter()
                .filter(|one| one.spinners > 1)
                .map(|one| one.id)
                .collect(),
            false => BTreeSet::new(),
        };
        let hidden = busy.iter().filter(silent).filter(|one| several.contains(&one.process));
        let whose = |one: &&Doubted| (one.node.clone(), one.topic.clone());
        let late = doubts.iter().filter(|one| one.why == Why::Late);
        let (within, lack): (Vec<_>, Vec<_>) = doubts.iter().partition(is_within);
        let lack = busy.iter().map(of_busy).chain(lack.iter().map(whose));
        let mut rest = Rest {
            left: lack.collect(),
            busy: busy.iter().map(of_busy).collect(),
            called: busy.iter().filter(taken).map(of_busy).collect(),
            hidden: hidden.map(of_busy).collect(),
            late: late.map(|one| whose(&one)).collect(),
            within: BTreeSet::new(),
        };
        rest.within = within.iter().map(whose).filter(|one| !rest.left.contains(one)).collect();
        rest.left.extend(rest.within.iter().cloned());
        Ok(rest)
    }

    /// After how long in vain no more is waited for, of a wait that lasts as long as `stall`; `None` while
    /// callbacks run. Who never sleeps may be about to do what is awaited: beside it that is waited for to the end
    /// at first, and half as long each time, but for a callback that may be what runs.
    fn limit(
        &self,
        lacks: &BTreeMap<Whose, Lacks>,
        stuck: &BTreeSet<Whose>,
        stall: Duration,
    ) -> Option<InVain> {
        let runs = |one: &Whose| !stuck.contains(one) && !self.hidden.contains(one);
        if self.called.iter().any(runs) {
            return None;
        }
        let known = |one: &Whose| lacks.get(one).copied().unwrap_or_default();
        let mut limit = InVain { asleep: Duration::ZERO, ran: Duration::ZERO };
        for one in self.left.iter().filter(|one| !stuck.contains(*one)) {
            let (most, whole) = (known(one).patience(DOUBTFUL), stall.max(DOUBTFUL));
            let (asleep, ran) = match self.hidden.contains(one) {
                true => (most.min(COMES_BACK), whole),
                false => (most, known(one).patience(whole)),
            };
            limit = InVain { asleep: limit.asleep.max(asleep), ran: limit.ran.max(ran) };
        }
        Some(limit)
    }

    /// Takes in that no more is waited for. Of what is not left any more, nothing lacks where something `came`:
    /// else nothing was sent that could lack.
    fn give_up(&self, lacks: &mut BTreeMap<Whose, Lacks>, came: impl Fn(&Whose) -> bool) {
        let whole = |whose: &Whose| !self.left.contains(whose) && came(whose);
        for (_, one) in lacks.iter_mut().filter(|(whose, _)| whole(whose)) {
            one.in_a_row = 0;
        }
        for whose in self.left.difference(&self.called) {
            let one = lacks.entry(whose.clone()).or_default();
            match self.within.contains(whose) {
                true => one.add_unseen(),
                false => one.add(self.late.contains(whose)),
            }
        }
    }
}

impl Stillness {
    /// Waits until nobody has work any more; `topics` are ours with the messages that went out by
    /// now through the process `player`. A callback is waited for as long as `patience`, and what may never come for a moment,
    /// the shorter the more often it did not.
    pub(crate) fn wait(
        &self,
        ledger: &Ledger,
        (player, topics): (u32, &[(String, u64)]),
        patience: Duration,
    ) -> Result<(), LedgerError> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let State { mark, sent, lacks, stuck } = &mut *state;
        let now: Vec<u64> = topics.iter().map(|topic| topic.1).collect();
        let Some(before) = mark else {
            (*mark, *sent) = (Some(ledger.mark()?), now);
            return Ok(());
        };
        sent.resize(now.len(), 0);
        let since: Vec<(&str, u64)> = topics
            .iter()
            .zip(&*sent)
            .map(|(topic, sent)| (topic.0.as_str(), topic.1 - sent))
            .collect();
        let (mut still, mut doubt, mut rest) = (None, Doubt::default(), Rest::default());
        let over = |ledger: &Ledger| {
            rest = match ask(ledger, before, &since, lacks)? {
                Quiet::Still(mark) => {
                    still = Some(mark);
                    stuck.rest();
                    // What was on its way at an earlier look has come.
                    rest = Rest::default();
                    return Ok(true);
                }
                Quiet::Working(busy, doubts) => Rest::of(ledger, &busy, &doubts)?,
                Quiet::Unknown(doubts) => Rest::of(ledger, &[], &doubts)?,
            };
            stuck.look(&rest.busy);
            let Some(limit) = rest.limit(lacks, &stuck.now, patience) else {
                doubt = Doubt::default();
                return Ok(false);
            };
            Ok(limit.asleep.is_zero()
                || doubt.look(Instant::now(), &ledger.awake(&[player])?).is_over(limit))
        };
        let waited = ledger.wait(&EVENTS, &[], Instant::now() + patience, over)?;
        let after = match still {
            Some(mark) => mark,
            None => ledger.mark()?,
        };
        if waited == Waited::Late {
            stuck.add(&rest.called);
        }
        rest.give_up(lacks, |(node, topic)| after.has_come_since(before, node, topic));
        (*mark, *sent) = (Some(after), now);
        Ok(())
    }

    /// What was not waited for any more, as sentences.
    pub(crate) fn remarks(&self) -> Vec<String> {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let remark = |(node, topic): &Whose| {
            format!(
                "what {node} was sent on {topic} did not all come to it, and more of it is waited for \
                 only for a moment: its queue or its quality of service lets messages go"
            )
        };
        let unseen = |(node, topic): &Whose| {
            format!(
                "what {node} is handed on {topic} within its process is not counted while it waits, and a thread \
                 there never slept: lock-step may go on before it has come, and two runs may differ"
            )
        };
        let named = |(node, topic): &Whose| !node.is_empty() && !topic.is_empty();
        let all = || state.lacks.iter().filter(|(whose, _)| named(whose));
        let certain = all().filter(|(_, lacks)| lacks.certain).map(|(whose, _)| remark(whose));
        let unseen = all().filter(|(_, lacks)| lacks.unseen).map(|(whose, _)| unseen(whose));
        let endless = state.stuck.ever.keys().map(|(node, topic)| {
            let whose = if node.is_empty() { topic.clone() } else { format!("{node} on {topic}") };
            format!(
                "a callback of {whose} was not over in the time that lock-step waits for one, so that it went on \
                 before its end"
            )
        });
        certain.chain(unseen).chain(endless).collect()
    }
}

fn is_within(doubt: &&Doubted) -> bool {
    doubt.why == Why::IntraProcess
}

/// Asks whether all is worked off, and again for a moment where nothing is in doubt but what may wait within a
/// process: it is not, once its threads are back from their callbacks, of which nobody wakes us.
fn ask(
    ledger: &Ledger,
    since: &Mark,
    sent: &[(&str, u64)],
    lacks: &BTreeMap<Whose, Lacks>,
) -> Result<Quiet, LedgerError> {
    for _ in 0..ASKED {
        let quiet = ledger.quiet(since, sent)?;
        if !matches!(&quiet, Quiet::Unknown(doubts) if may_be_over_soon(doubts, lacks)) {
            return Ok(quiet);
        }
        std::thread::sleep(SOON);
    }
    ledger.quiet(since, sent)
}

/// Whether nothing is in doubt but what may wait within a process, and some of it is waited for still.
fn may_be_over_soon(doubts: &[Doubted], lacks: &BTreeMap<Whose, Lacks>) -> bool {
    let is_waited_for = |one: &Doubted| {
        let known = lacks.get(&(one.node.clone(), one.topic.clone()));
        known.is_none_or(|lacks| lacks.in_a_row < IN_A_ROW)
    };
    doubts.iter().all(|one| is_within(&one)) && doubts.iter().any(is_waited_for)
}

fn of_busy(busy: &Busy) -> Whose {
    let others =
        || format!("process {}, of {} timers and services,", busy.process.pid, busy.in_hand);
    (busy.node.clone(), busy.topic.clone().unwrap_or_else(others))
}

#[cfg(test)]
mod tests {
    use super::*;

    const STALL: Duration = Duration::from_secs(10);

    fn whose(node: &str) -> Whose {
        (node.to_owned(), "/topic".to_owned())
    }

    /// Nobody took anything.
    fn nothing(_: &Whose) -> bool {
        false
    }

    /// A limit, in seconds.
    fn in_vain(asleep: f64, ran: f64) -> Option<InVain> {
        let [asleep, ran] = [asleep, ran].map(Duration::from_secs_f64);
        Some(InVain { asleep, ran })
    }

    #[test]
    fn what_did_not_come_is_waited_for_again_and_less_each_time() {
        let ms = |lacks: Lacks| lacks.patience(DOUBTFUL).as_secs_f64() * 1000.0;
        let (mut steady, mut lacks) = (Lacks::default(), Vec::new());
        for _ in 0..9 {
            lacks.push(ms(steady));
            steady.add(false);
        }
        assert_eq!(lacks, [1000.0, 1000.0, 500.0, 250.0, 125.0, 62.5, 31.25, 15.625, 0.0]);
        steady.in_a_row = 0;
        assert_eq!(ms(steady), 15.625);
    }

    #[test]
    fn one_doubt_about_what_is_new_is_none_once_the_rest_came() {
        let lacking = |late: bool| {
            let left = BTreeSet::from([whose("/node")]);
            let late = if late { left.clone() } else { BTreeSet::new() };
            Rest { left, late, ..Rest::default() }
        };
        let mut lacks = BTreeMap::new();
        lacking(true).give_up(&mut lacks, nothing);
        Rest::default().give_up(&mut lacks, |_| true);
        lacking(true).give_up(&mut lacks, nothing);
        let known = lacks[&whose("/node")];
        assert_eq!(known, Lacks { times: 2, in_a_row: 1, certain: false, unseen: false });
        assert_eq!(lacking(false).limit(&lacks, &BTreeSet::new(), STALL), in_vain(0.5, 5.0));
        lacking(true).give_up(&mut lacks, nothing);
        assert!(lacks[&whose("/node")].certain);
        let mut lacks = BTreeMap::new();
        lacking(false).give_up(&mut lacks, nothing);
        assert!(lacks[&whose("/node")].certain);
    }

    #[test]
    fn a_callback_that_never_ends_is_not_waited_for_and_what_is_in_doubt_beside_it_is() {
        let (hangs, both) = (whose("/hangs"), [whose("/hangs"), whose("/node")]);
        let stuck = BTreeSet::from([hangs]);
        let rest = Rest {
            left: both.into(),
            busy: stuck.clone(),
            called: stuck.clone(),
            ..Rest::default()
        };
        let mut lacks = BTreeMap::new();
        assert_eq!(rest.limit(&lacks, &BTreeSet::new(), STALL), None);
        assert_eq!(rest.limit(&lacks, &stuck, STALL), in_vain(1.0, 10.0));
        rest.give_up(&mut lacks, nothing);
        assert_eq!(lacks.keys().collect::<Vec<_>>(), [&whose("/node")]);
    }

    #[test]
    fn where_nothing_came_nothing_has_come_that_lacked_before() {
        let lacking = Rest { left: BTreeSet::from([whose("/node")]), ..Rest::default() };
        let mut lacks = BTreeMap::new();
        // Between two of its messages time goes on, and others are sent theirs.
        for _ in 0..8 {
            lacking.give_up(&mut lacks, nothing);
            Rest::default().give_up(&mut lacks, |whose| whose.0 != "/node");
        }
        assert_eq!(lacking.limit(&lacks, &BTreeSet::new(), STALL), in_vain(0.0, 0.0));
        // What came in part lacks.
        lacking.give_up(&mut lacks, |_| true);
        assert_eq!(lacking.limit(&lacks, &BTreeSet::new(), STALL), in_vain(0.0, 0.0));
        Rest::default().give_up(&mut lacks, |_| true);
        assert_eq!(lacks[&whose("/node")].in_a_row, 0);
        let last = 1.0 / 64.0;
        let again = lacking.limit(&lacks, &BTreeSet::new(), STALL);
        assert_eq!(again, in_vain(last, 10.0 * last));
    }

    #[test]
    fn who_never_lacked_is_waited_for_to_the_end_beside_one_that_never_sleeps() {
        let of = |some: &[&str]| Rest {
            left: some.iter().map(|one| whose(one)).collect(),
            ..Rest::default()
        };
        let (mut lacks, none) = (BTreeMap::new(), BTreeSet::new());
        for seconds in [10.0, 10.0, 5.0, 2.5] {
            let alone = of(&["/lacks"]).limit(&lacks, &none, STALL);
            assert_eq!(alone, in_vain(seconds / 10.0, seconds));
            let both = of(&["/lacks", "/slow"]).limit(&lacks, &none, STALL);
            assert_eq!(both, in_vain(1.0, 10.0));
            of(&["/lacks"]).give_up(&mut lacks, nothing);
        }
    }

    fn doubted(why: Why) -> Doubted {
        let (node, topic) = whose("/node");
        Doubted { node, topic, missing: 1, why }
    }

    #[test]
    fn what_was_not_seen_within_a_process_is_named_as_that_and_hides_no_loss() {
        let ledger = Ledger::new().unwrap();
        let remarks = |doubts: &[Doubted]| {
            let stillness = Stillness::default();
            let rest = Rest::of(&ledger, &[], doubts).unwrap();
            for _ in 0..2 {
                rest.give_up(&mut stillness.state.lock().unwrap().lacks, nothing);
            }
            stillness.remarks().join("; ")
        };
        let unseen = remarks(&[doubted(Why::IntraProcess)]);
        let begins = "what /node is handed on /topic within its process is not counted";
        assert!(unseen.starts_with(begins) && !unseen.contains("did not all come"), "{unseen}");
        let lost = remarks(&[doubted(Why::BestEffort)]);
        assert!(lost.starts_with("what /node was sent on /topic did not all come to it"), "{lost}");
        // Of two subscriptions of a node.
        for why in [Why::BestEffort, Why::Late] {
            assert_eq!(remarks(&[doubted(Why::IntraProcess), doubted(why)]), lost);
        }
    }

    #[test]
    fn who_is_at_the_end_of_a_callback_may_lack_something() {
        let (mut stuck, all) = (Stuck::default(), BTreeSet::from([whose("/node")]));
        stuck.add(&all);
        stuck.look(&Rest { left: all, ..Rest::default() }.busy);
        assert!(stuck.now.is_empty());
    }

    #[test]
    fn what_waits_within_a_process_is_asked_for_again_as_long_as_it_is_waited_for() {
        let within = [doubted(Why::IntraProcess)];
        let (mut lacks, is_asked) = (BTreeMap::new(), may_be_over_soon);
        for _ in 0..IN_A_ROW {
            assert!(is_asked(&within, &lacks));
            lacks.entry(whose("/node")).or_insert_with(Lacks::default).add_unseen();
        }
        assert!(!is_asked(&within, &lacks));
        lacks.clear();
        assert!(!is_asked(&[doubted(Why::IntraProcess), doubted(Why::BestEffort)], &lacks));
    }

    #[test]
    fn callbacks_that_run_are_waited_for_and_hidden_ones_for_a_moment() {
        let all = BTreeSet::from([whose("/node")]);
        let rest = |called: bool, hidden: bool| Rest {
            left: all.clone(),
            busy: all.clone(),
            called: if called { all.clone() } else { BTreeSet::new() },
            hidden: if hidden { all.clone() } else { BTreeSet::new() },
            ..Rest::default()
        };
        let (nobody, none) = (BTreeMap::new(), BTreeSet::new());
        assert_eq!(rest(true, false).limit(&nobody, &none, STALL), None);
        assert_eq!(rest(true, false).limit(&nobody, &all, STALL), in_vain(0.0, 0.0));
        // One that is awake may be in that callback.
        assert_eq!(rest(true, true).limit(&nobody, &none, STALL), in_vain(0.1, 10.0));
        let once = BTreeMap::from([(whose("/node"), Lacks { times: 6, ..Lacks::default() })]);
        assert_eq!(rest(true, true).limit(&once, &none, STALL), in_vain(0.03125, 10.0));
        assert_eq!(rest(false, false).limit(&once, &none, STALL), in_vain(0.03125, 0.3125));
        // However short the whole wait is, it is no shorter than while all sleep.
        let short = Duration::from_millis(5);
        assert_eq!(rest(false, false).limit(&once, &none, short), in_vain(0.03125, 0.03125));
        assert_eq!(rest(false, false).limit(&nobody, &none, STALL), in_vain(1.0, 10.0));
        let lacks = BTreeMap::from([(whose("/node"), Lacks { in_a_row: 8, ..Lacks::default() })]);
        assert_eq!(rest(false, false).limit(&lacks, &none, STALL), in_vain(0.0, 0.0));
    }
}

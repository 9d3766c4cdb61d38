//! The way of a replay, from the first registration to the finished recording.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

use bagpipe_graph::{Node, NodeOptions, PacedBy, Publication, Share, TopicInfo};
use bagpipe_log::Recording;

use crate::answers::Answers;
use crate::clock::BagClock;
use crate::discovery::Discovery;
use crate::drain::{Drain, PAUSE, SWEEP};
use crate::ledger::{ledger, present};
use crate::lockstep::Lockstep;
use crate::machine::{Foreign, Gauge};
use crate::outcome::{Ledger, LedgerSubscriber, Playback, Replayed, Strength, Timings};
use crate::patience::Patience;
use crate::plan::Plan;
use crate::play::{Pace, Player};
use crate::processes::{Processes, Waiting};
use crate::prove::Proof;
use crate::recorder::{Recorder, Room};
use crate::simulate::Turns;
use crate::step::Stepper;
use crate::subscribe::wait_for_stack;
use crate::time::{Stopwatch, Time};
use crate::watch::Watch;
use crate::world::World;
use crate::{Cancellation, Mode, Progress, ReplayError, ReplayRequest, Stage};

/// The deadline of every call to the master and of every handshake.
const CALL: Duration = Duration::from_secs(3);
/// The deadline of a question to a node; roscpp and rospy answer within milliseconds.
const ASK: Duration = Duration::from_secs(2);
/// How often nodes are asked and topics are sought during the play.
const ROUND: Duration = Duration::from_millis(500);
/// The most that the end of the lead-in waits for it to be received.
const LEAD_IN: Duration = Duration::from_secs(1);
/// A lead-in that has not changed for this time is over.
const LEAD_IN_STABLE: Duration = Duration::from_millis(500);

/// [`replay_together`] of a single bag.
///
/// # Errors
/// As that.
pub fn replay(
    bag: &dyn Recording,
    request: &ReplayRequest,
    progress: &mut dyn FnMut(Progress),
    cancelled: &dyn Fn() -> Option<Cancellation>,
) -> Result<Replayed, ReplayError> {
    replay_together(&[bag], request, progress, cancelled)
}

/// Plays bags as one timeline, records and proves. Messages of the same time keep the order of
/// the bags, whose bytes are not copied. Blocks; every thread that it starts ends before it returns.
/// `progress` is called when a stage begins and twice a second; `cancelled` is asked at
/// least every 50 ms.
///
/// # Errors
/// See [`ReplayError`]; a window without messages is not an error.
pub fn replay_together(
    bags: &[&dyn Recording],
    request: &ReplayRequest,
    progress: &mut dyn FnMut(Progress),
    cancelled: &dyn Fn() -> Option<Cancellation>,
) -> Result<Replayed, ReplayError> {
    request.validate()?;
    let plan = Plan::new(bags, request)?;
    carry_out(&plan, request, None, progress, cancelled)
}

/// Plays a world's topics as [`crate::replay`] plays a bag's: lock-stepped, recorded and proved.
/// The world's own messages are recorded too, as published by `/bagpipe_simulator`, except those
/// of [`World::unrecorded`].
///
/// # Errors
/// As [`crate::replay_together`], and what the world's turns end with.
pub fn simulate(
    topics: Vec<TopicInfo>,
    request: &ReplayRequest,
    world: &mut dyn World,
    progress: &mut dyn FnMut(Progress),
    cancelled: &dyn Fn() -> Option<Cancellation>,
) -> Result<Replayed, ReplayError> {
    request.validate()?;
    carry_out(&Plan::of_topics(topics), request, Some(world), progress, cancelled)
}

/// Plays a plan, or a world's turns on the plan's topics.
fn carry_out(
    plan: &Plan<'_>,
    request: &ReplayRequest,
    world: Option<&mut dyn World>,
    progress: &mut dyn FnMut(Progress),
    cancelled: &dyn Fn() -> Option<Cancellation>,
) -> Result<Replayed, ReplayError> {
    let limit = request.window.end.saturating_add(nanoseconds(request.drain_deadline));
    let clock = Arc::new(BagClock::new(Time::Machine, request.window.lead_in_start, limit));
    let ordered = request.mode == Mode::Lockstep;
    let steps = if ordered { request.steps.as_slice() } else { &[] };
    let lockstep =
        Lockstep::new(steps, &plan.topics, &*request.middleware)?.metered(&request.meter);
    let answers = Answers::new(lockstep.awaited());
    let answers = Arc::new(if world.is_some() { answers.keeping() } else { answers });
    let file = request.record_to.as_deref().map(recording_file).transpose()?;
    let format = Arc::clone(&request.record_as);
    let room = Room { bytes: request.byte_budget, format, file };
    let recorder = Recorder::new(Arc::clone(&clock), room, Arc::clone(&answers), ordered);
    if plan.is_empty() && world.is_none() {
        return finish(&recorder, Replayed::default());
    }
    let sink = Box::new(recorder.clone());
    let node =
        request.middleware.join(node_options(request), sink).map_err(ReplayError::GraphFailed)?;
    let mut watch = Watch::new(request, &recorder, &clock, progress, cancelled);
    let scene = Scene { node: &*node, plan, request, recorder: &recorder, clock: &clock };
    let outcome = perform(&scene, (lockstep, answers), world, &mut watch)?;
    whole(&*node)?;
    drop(node);
    if let Some(failure) = recorder.failure() {
        return Err(failure);
    }
    let replayed = finish(&recorder, outcome)?;
    request.meter.held(replayed.recorded.high_water_bytes);
    Ok(replayed)
}

fn recording_file(path: &Path) -> Result<File, ReplayError> {
    File::create_new(path).map_err(|error| {
        ReplayError::Internal(format!("cannot record into {}: {error}", path.display()))
    })
}

fn finish(recorder: &Recorder, mut outcome: Replayed) -> Result<Replayed, ReplayError> {
    (outcome.recorded, outcome.recorded_bag) = recorder.finish()?;
    Ok(outcome)
}

pub(crate) fn node_options(request: &ReplayRequest) -> NodeOptions {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    NodeOptions {
        name: format!("/bagpipe_player_{}_{number}", std::process::id()),
        call_deadline: CALL,
        stall: request.drain_deadline,
        max_message: usize::try_from(request.byte_budget).unwrap_or(usize::MAX),
        paced_by: match request.mode {
            Mode::Realtime => PacedBy::Schedule,
            Mode::Max | Mode::Lockstep => PacedBy::Subscribers,
        },
    }
}

/// What a replay works with.
struct Scene<'a> {
    node: &'a dyn Node,
    plan: &'a Plan<'a>,
    request: &'a ReplayRequest,
    recorder: &'a Recorder,
    clock: &'a BagClock,
}

/// Everything between the first registration and the last proof.
fn perform(
    scene: &Scene<'_>,
    (lockstep, answers): (Lockstep, Arc<Answers>),
    world: Option<&mut dyn World>,
    watch: &mut Watch<'_>,
) -> Result<Replayed, ReplayError> {
    let &Scene { node, plan, request, recorder, clock } = scene;
    let mut stopwatch = Stopwatch::start(watch.now());
    watch.enter(Stage::Subscribe);
    let mut discovery = Discovery::start(node, &request.record_topics, watch.time())?;
    discovery.listen_for(&lockstep, recorder)?;
    let turns = world.map(|world| Turns::new(world, &answers, recorder, plan, request));
    let stepper = (request.mode == Mode::Lockstep)
        .then(|| Stepper::new(node, lockstep, Arc::clone(&answers), recorder));
    let mut player = Player::advertise(node, plan, clock, request, stepper)?;
    wait_for_stack(&discovery, &mut player, request, watch)?;
    let (proof, pids) = meet(node, &discovery)?;
    let rounds = Rounds::new(proof, player.publications().to_vec());
    // Once now: a restarted master would not know where the nodes are.
    rounds.ask();
    let foreign = Foreign::new(Mutex::new(pids.values().copied().collect()));
    let mut processes = Processes::meet(pids.values().copied().collect());
    let subscribe = stopwatch.lap(watch.now());

    let window = request.window;
    let (lead_in, gauge, waiting, pace) = std::thread::scope(|scope| {
        scope.spawn(|| rounds.run(&discovery));
        let _ends = EndOnDrop(&rounds);
        watch.enter(Stage::LeadIn);
        warm_up(&rounds, &mut player, plan, request, watch)?;
        let lead_in = stopwatch.lap(watch.now());
        watch.enter(Stage::Play);
        clock.stand(window.start);
        let (gauge, waiting) = (Gauge::start(&foreign), Waiting::begin(&pids));
        begin_to_count(node, recorder, window.start);
        let schedule = player.schedule(window.start, watch.now());
        let pace = match turns {
            Some(turns) => turns.play(&mut player, watch)?,
            None => player.play(plan.counted.clone(), schedule, Share::Counted, watch)?,
        };
        Ok::<_, ReplayError>((lead_in, gauge, waiting, pace))
    })?;
    let play = stopwatch.lap(watch.now());

    watch.enter(Stage::Drain);
    let there = present(player.publications());
    let mut proof = rounds.into_proof();
    let drain = Drain { node, request, recorder, since: watch.now() };
    drain.prove(&mut proof, &mut player, watch)?;
    let waited = waiting.seconds();
    drain.listen(&mut proof, &mut processes, &mut player, watch)?;
    let timings = Timings { subscribe, lead_in, play, drain: stopwatch.lap(watch.now()) };
    let ledger = conclude(&player, &mut proof, &there, &waited);
    let playback = report(&mut player, &discovery, playback(request, pace), &ledger, request.mode);
    let machine = Some(gauge.finish(playback.late_max_seconds));
    Ok(Replayed { ledger, playback, timings, machine, ..Replayed::default() })
}

/// Refuses a recording that lacks what the stack has published, where that is known.
fn whole(node: &dyn Node) -> Result<(), ReplayError> {
    let lacking = node.lacking();
    if lacking.is_empty() { Ok(()) } else { Err(ReplayError::RecordingIncomplete(lacking)) }
}

/// Learns which nodes there are, and which processes are theirs.
fn meet(
    node: &dyn Node,
    discovery: &Discovery<'_>,
) -> Result<(Proof, BTreeMap<String, i32>), ReplayError> {
    let mut proof = Proof::new(node.audit(ASK));
    let pids = proof.meet(&discovery.others()?);
    Ok((proof, pids))
}

/// Plays what is latched, and then the lead-in; each is received before the next thing
/// begins, since no order holds between the connections of different topics.
fn warm_up(
    rounds: &Rounds,
    player: &mut Player<'_>,
    plan: &Plan<'_>,
    request: &ReplayRequest,
    watch: &mut Watch<'_>,
) -> Result<(), ReplayError> {
    let window = request.window;
    if !plan.latched.is_empty() {
        player.play_latched(watch)?;
        await_lead_in(rounds, player, request, watch)?;
    }
    let schedule = player.schedule(window.lead_in_start, watch.now());
    player.play(plan.lead_in.clone(), schedule, Share::LeadIn, watch)?;
    player.wait_until(window.start, schedule, watch)?;
    if !plan.lead_in.is_empty() {
        await_lead_in(rounds, player, request, watch)?;
    }
    Ok(())
}

/// Records from now on, with what is latched in force at the window's start.
pub(crate) fn begin_to_count(node: &dyn Node, recorder: &Recorder, start: u64) {
    recorder.latch_after_all(&node.latching_after_all(ASK));
    // What was published before the window is before it, however late it comes to us.
    node.sweep(SWEEP);
    recorder.count_from(start);
}

/// Waits until what was sent of the lead-in has been received, so that it can be
/// separated from the window. Bag time stands meanwhile.
fn await_lead_in(
    rounds: &Rounds,
    player: &Player<'_>,
    request: &ReplayRequest,
    watch: &mut Watch<'_>,
) -> Result<(), ReplayError> {
    let now = watch.now();
    let (deadline, busy) = (now + LEAD_IN, now + request.drain_deadline.max(LEAD_IN));
    let patience = Patience { deadline, busy, stable: LEAD_IN_STABLE };
    let mut proof = rounds.proof.lock().unwrap_or_else(PoisonError::into_inner);
    let time = watch.time();
    proof.settle(player.publications(), &patience, time, || watch.sleep(PAUSE).map(|()| false))?;
    proof.end_lead_in(player.publications());
    Ok(())
}

/// The ledger of all that is known in the end; `waited` are seconds by node.
fn conclude(
    player: &Player<'_>,
    proof: &mut Proof,
    there: &[BTreeSet<u64>],
    waited: &BTreeMap<String, f64>,
) -> Ledger {
    take_answers(player, proof);
    let mut ledger = ledger(player.publications(), player.played(), there, proof);
    ledger.add_waits(waited);
    ledger
}

/// What the answers of a lock-step play prove. They are those of a topic's only subscriber,
/// or of the one that published them all.
fn take_answers(player: &Player<'_>, proof: &mut Proof) {
    for (at, publishers) in player.answered() {
        let links = player.publications()[at].subscribers();
        let nodes: BTreeSet<&String> = links.iter().map(|link| &link.node).collect();
        for link in &links {
            let published_all = publishers.len() == 1 && publishers.contains(&link.node);
            if nodes.len() == 1 || published_all {
                proof.answered(at, link);
            }
        }
    }
}

/// What goes on beside the play, on the machine's clock: nodes are asked now and then, so that
/// something is known of those that leave early, and new topics are sought.
struct Rounds {
    proof: Mutex<Proof>,
    topics: Vec<Arc<dyn Publication>>,
    over: Mutex<bool>,
    end: Condvar,
}

impl Rounds {
    fn new(proof: Proof, topics: Vec<Arc<dyn Publication>>) -> Rounds {
        Rounds { proof: Mutex::new(proof), topics, over: Mutex::new(false), end: Condvar::new() }
    }

    fn run(&self, discovery: &Discovery<'_>) {
        loop {
            let over = self.over.lock().unwrap_or_else(PoisonError::into_inner);
            let waited = self.end.wait_timeout_while(over, ROUND, |over| !*over);
            match waited {
                Ok((over, _)) if !*over => {}
                _ => return,
            }
            // A master that fails now fails the case only if a figure will be missing.
            let _master_busy = discovery.look();
            self.ask();
        }
    }

    fn ask(&self) {
        self.proof.lock().unwrap_or_else(PoisonError::into_inner).ask(&self.topics);
    }

    fn into_proof(self) -> Proof {
        self.proof.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Ends the rounds when the play ends, in whatever way.
struct EndOnDrop<'a>(&'a Rounds);

impl Drop for EndOnDrop<'_> {
    fn drop(&mut self) {
        *self.0.over.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.0.end.notify_all();
    }
}

fn playback(request: &ReplayRequest, pace: Pace) -> Playback {
    let played = pace.took.as_secs_f64();
    let bag = pace.last.map_or(0, |last| last.saturating_sub(request.window.start)) as f64 / 1e9;
    Playback {
        asked_rate: request.rate,
        achieved_rate: if bag > 0.0 && played > 0.0 { bag / played } else { request.rate },
        late_max_seconds: match request.mode {
            Mode::Realtime => pace.late.as_secs_f64(),
            Mode::Max | Mode::Lockstep => 0.0,
        },
        played_seconds: played,
        ..Playback::default()
    }
}

/// Adds what the user should know of the play.
fn report(
    player: &mut Player<'_>,
    discovery: &Discovery<'_>,
    mut playback: Playback,
    ledger: &Ledger,
    mode: Mode,
) -> Playback {
    playback.warnings = warnings(ledger, mode);
    playback.pace = (mode == Mode::Max).then(|| ledger.pace(playback.played_seconds)).flatten();
    let topics = player.publications().iter();
    let refused: BTreeSet<String> = topics.flat_map(|topic| topic.refused()).collect();
    playback.warnings.extend(refused);
    playback.warnings.extend(discovery.restarted());
    playback.warnings.extend(discovery.node.remarks());
    if mode == Mode::Lockstep {
        playback.warnings.extend(discovery.node.undetermined());
    }
    let (steps, unpaired) = player.end_steps();
    playback.steps = steps;
    playback.warnings.extend(unpaired);
    playback
}

/// What the losses mean, in words.
fn warnings(ledger: &Ledger, mode: Mode) -> Vec<String> {
    let advice = match mode {
        Mode::Max => {
            "its queue is shorter than what arrives while its callback runs; play in lockstep \
             or realtime, or give it a longer queue"
        }
        Mode::Realtime => {
            "its callback takes longer than the messages' distance and its queue is short"
        }
        Mode::Lockstep => {
            "its queue is shorter than what arrives between two answers; declare a step for it"
        }
    };
    let lines = ledger.topics.iter().flat_map(|topic| {
        // Of who is not known to have received anything it is not known what was lost either.
        let lost = |line: &&LedgerSubscriber| line.dropped > 0 && line.strength > Strength::Sent;
        topic.subscribers.iter().filter(lost).map(move |line| {
            let (node, name, dropped, sent) = (&line.node, &topic.topic, line.dropped, topic.sent);
            format!("{node} lost {dropped} of {sent} messages of {name}: {advice}")
        })
    });
    lines.collect()
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

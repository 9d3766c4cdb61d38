//! Before the first input: the recorder finds its topics, the stack finds ours.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bagpipe_graph::Publication;

use crate::discovery::{Discovery, LOOK, open_subscribers, others};
use crate::first_time::FirstTime;
use crate::names::resolved;
use crate::play::Player;
use crate::settle::settle;
use crate::startup::Startup;
use crate::watch::Watch;
use crate::{ReplayError, ReplayRequest};

/// The time between two looks at the master while subscribers are awaited.
const DISCOVER: Duration = Duration::from_millis(100);
/// The same once there are some, so that more have half a second at most.
const CONFIRM: Duration = Duration::from_millis(20);

/// Waits until the stack is there.
///
/// # Errors
/// [`ReplayError::NeverSubscribed`] after the deadline, and whatever stops the watch.
pub(crate) fn wait_for_stack(
    discovery: &Discovery<'_>,
    player: &mut Player<'_>,
    request: &ReplayRequest,
    watch: &mut Watch<'_>,
) -> Result<(), ReplayError> {
    let begun = watch.now();
    let deadline = begun + request.subscribe_deadline;
    let any = request.topics.is_empty().then_some(request.start.stable);
    let mut waiting = Waiting::new(player.required(), any, begun);
    let mut next_look = begun;
    let first_time = FirstTime::new(request, begun);
    let mut startup = Startup::below(request.start.at_rest_below);
    loop {
        watch.check()?;
        let now = watch.now();
        if now >= next_look {
            let state = discovery.look()?;
            first_time.show(state.as_ref(), &mut startup, player, watch)?;
            let complete = |state| startup.is_complete(state, discovery.node);
            waiting.complete = state.as_ref().is_some_and(complete);
            next_look = now + if waiting.links > 0 { CONFIRM } else { DISCOVER };
        }
        let unanswered = discovery.unanswered();
        let mut absent = absent(player.publications(), request);
        absent.extend(discovery.node.absent());
        if absent.is_empty()
            && unanswered.is_empty()
            && waiting.is_over(player.publications(), now, deadline)
        {
            break;
        }
        if now >= deadline {
            if !absent.is_empty() {
                return Err(still_waiting(&absent, request));
            }
            if !unanswered.is_empty() && waiting.is_over(player.publications(), now, deadline) {
                return Err(never_advertised(&unanswered, request));
            }
            let missing = waiting.missing(player.publications());
            return Err(never_subscribed(discovery, player, &missing, request));
        }
        watch.sleep_until(now + LOOK)?;
    }
    settle(discovery, player, &first_time, &mut startup, watch)?;
    begin(discovery, player, request, watch)
}

/// Lets the play begin, after its delay.
fn begin(
    discovery: &Discovery<'_>,
    player: &mut Player<'_>,
    request: &ReplayRequest,
    watch: &mut Watch<'_>,
) -> Result<(), ReplayError> {
    // Whoever is there has this time before the next one, in each run.
    player.show_clock_to_all(watch)?;
    let begin = watch.now() + request.start.delay;
    while watch.now() < begin {
        watch.sleep_until(begin.min(watch.now() + LOOK))?;
        player.show_clock(watch)?;
        // Who comes meanwhile is met before the play begins.
        discovery.look()?;
    }
    match discovery.node.begin() {
        gone if gone.is_empty() => Ok(()),
        gone => Err(ReplayError::NodeInactive(format!(
            "the play was to begin, and was waiting again for {}",
            gone.join(", ")
        ))),
    }
}

/// What the request wants to wait for and is not there, in words.
fn absent(topics: &[Arc<dyn Publication>], request: &ReplayRequest) -> Vec<String> {
    let connected: Vec<(&str, BTreeSet<String>)> =
        topics.iter().map(|topic| (topic.info().topic.as_str(), open_subscribers(topic))).collect();
    let nodes = request.start.nodes.iter().map(|node| resolved(node));
    let mut absent: Vec<String> =
        nodes.filter(|node| !connected.iter().any(|(_, there)| there.contains(node))).collect();
    for (topic, wanted) in &request.start.subscribers {
        let topic = resolved(topic);
        let there = connected.iter().find(|(name, _)| *name == topic).map_or(0, |(_, n)| n.len());
        if there < *wanted {
            absent.push(format!("{wanted} subscribers of {topic} (there are {there})"));
        }
    }
    absent
}

fn still_waiting(absent: &[String], request: &ReplayRequest) -> ReplayError {
    ReplayError::NeverSubscribed(format!(
        "waited in vain for {} for {:.1} s",
        absent.join(", "),
        request.subscribe_deadline.as_secs_f64()
    ))
}

/// The state of the wait.
pub(crate) struct Waiting {
    required: Vec<usize>,
    any: Option<Duration>,
    links: usize,
    since: Instant,
    /// Whether nobody was still to come at the last look.
    pub(crate) complete: bool,
}

impl Waiting {
    /// For these of the topics or, where `any` will do, until no more have come to them for that time.
    pub(crate) fn new(required: Vec<usize>, any: Option<Duration>, now: Instant) -> Waiting {
        Waiting { required, any, links: 0, since: now, complete: false }
    }

    /// Whether nobody is waited for any more.
    pub(crate) fn is_over(
        &mut self,
        topics: &[Arc<dyn Publication>],
        now: Instant,
        deadline: Instant,
    ) -> bool {
        let Some(stable) = self.any else {
            return self.missing(topics).is_empty();
        };
        let links = self.required.iter().map(|at| open_subscribers(&topics[*at]).len()).sum();
        if links != self.links {
            (self.links, self.since) = (links, now);
        }
        let stable = self.complete || now.duration_since(self.since) >= stable;
        links > 0 && (stable || now >= deadline)
    }

    /// The required topics that nobody subscribes to.
    fn missing(&self, topics: &[Arc<dyn Publication>]) -> Vec<String> {
        let required = self.required.iter().map(|at| &topics[*at]);
        let missing = required.filter(|publication| open_subscribers(publication).is_empty());
        missing.map(|publication| publication.info().topic.clone()).collect()
    }
}

fn never_advertised(answers: &[&str], request: &ReplayRequest) -> ReplayError {
    ReplayError::NeverSubscribed(format!(
        "nobody published {} within {:.1} s, which the steps name as an answer; is the name \
         right? Let the step be optional if its node appears only during the play",
        answers.join(", "),
        request.subscribe_deadline.as_secs_f64()
    ))
}

fn never_subscribed(
    discovery: &Discovery<'_>,
    player: &Player<'_>,
    missing: &[String],
    request: &ReplayRequest,
) -> ReplayError {
    let mut sentence = format!(
        "nobody subscribed to {} within {:.1} s",
        missing.join(", "),
        request.subscribe_deadline.as_secs_f64()
    );
    let refused = player.publications().iter().flat_map(|publication| publication.refused());
    let refused: BTreeSet<String> = refused.collect();
    for refusal in refused {
        sentence.push_str(&format!("; {refusal}"));
    }
    let state = discovery.look().ok().flatten().unwrap_or_default();
    let mut found = BTreeMap::new();
    for (topic, nodes) in &state.subscribers {
        let nodes: Vec<&str> =
            others(Some(nodes), discovery.node.name()).map(String::as_str).collect();
        if !nodes.is_empty() {
            found.insert(topic, nodes.join(", "));
        }
    }
    let found: Vec<String> =
        found.into_iter().map(|(topic, nodes)| format!("{topic} (by {nodes})")).collect();
    sentence.push_str(&if found.is_empty() {
        "; the stack's nodes subscribe to nothing at all".to_owned()
    } else {
        format!("; the stack's nodes subscribe to {}; remap joins the names", found.join(", "))
    });
    ReplayError::NeverSubscribed(sentence)
}

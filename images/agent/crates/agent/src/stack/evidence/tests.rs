use std::time::Duration;

use super::*;

/// A replay of 10 s with a lead-in of 2 s, whose input is all out after 12 s.
fn course(begun: Instant) -> Vec<Moment> {
    let moment = |seconds: u64, stage: Stage, bag_seconds: f64| Moment {
        at: begun + Duration::from_secs(seconds),
        stage,
        bag_seconds,
    };
    vec![
        moment(0, Stage::Subscribe, -2.0),
        moment(1, Stage::LeadIn, -2.0),
        moment(3, Stage::Play, 0.0),
        moment(13, Stage::Drain, 10.0),
    ]
}

fn end(pid: i32, at: Instant, exit_status: Option<i32>, signal: Option<i32>) -> ProcessEnd {
    let known = exit_status.is_some() || signal.is_some();
    let ended = known.then_some(Ended { exit_status, signal });
    ProcessEnd { pid, name: "python3".to_owned(), ended, at }
}

fn node(pid: i32) -> Known {
    Known {
        name: "/tracker".to_owned(),
        uri: "http://127.0.0.1:1/".to_owned(),
        pid: Some(pid),
        stayed: false,
        began: None,
    }
}

/// Cause and thing of each end.
fn judged(ends: &[ProcessEnd], found: Option<Found>, begun: Instant) -> Vec<(String, String)> {
    let nodes = found.map(|found| (node(7), found)).into_iter().collect();
    let course = course(begun);
    let facts =
        Facts { command: Some((1, "roslaunch")), ends, nodes, course: &course, ..Facts::default() };
    let pairs = facts.evidence().into_iter();
    pairs
        .map(|end| (end.cause.name().to_owned(), format!("{:?}", end.what).to_lowercase()))
        .collect()
}

fn one(cause: &str, what: &str) -> Vec<(String, String)> {
    vec![(cause.to_owned(), what.to_owned())]
}

#[test]
fn a_node_that_is_gone_is_reported_with_how_it_ended() {
    let begun = Instant::now();
    let (play, drain) = (begun + Duration::from_secs(5), begun + Duration::from_secs(14));
    let gone = |end: ProcessEnd| judged(&[end], Some(Found::Unregistered), begun);
    assert_eq!(gone(end(7, play, None, Some(11))), one("StackCrashed", "node"));
    assert_eq!(gone(end(7, play, Some(1), None)), one("StackCrashed", "node"));
    assert_eq!(gone(end(7, play, Some(0), None)), one("NodeGone", "node"));
    assert_eq!(gone(end(7, play, None, None)), one("NodeGone", "node"));
    // Right after the last answer.
    assert_eq!(gone(end(7, drain, None, Some(11))), one("StackCrashed", "node"));
    // It is done, and says so.
    assert_eq!(gone(end(7, drain, Some(0), None)), []);
    assert_eq!(gone(end(7, drain, None, None)), []);
    let unreachable = judged(&[end(7, drain, None, None)], Some(Found::Unreachable), begun);
    assert_eq!(unreachable, one("NodeGone", "node"));
    assert_eq!(judged(&[], Some(Found::Unregistered), begun), one("NodeGone", "node"));
    assert_eq!(judged(&[], Some(Found::Same), begun), []);
}

#[test]
fn a_node_that_came_back_is_reported_once() {
    let begun = Instant::now();
    let crash = end(7, begun + Duration::from_secs(5), None, Some(6));
    assert_eq!(judged(&[crash], Some(Found::Another), begun), one("NodeRespawned", "node"));
    assert_eq!(judged(&[], Some(Found::Another), begun), one("NodeRespawned", "node"));
}

#[test]
fn a_command_may_end_well_once_it_had_everything() {
    let begun = Instant::now();
    let (play, drain) = (begun + Duration::from_secs(5), begun + Duration::from_secs(14));
    let command = |end: ProcessEnd| judged(&[end], None, begun);
    assert_eq!(command(end(1, drain, Some(0), None)), []);
    assert_eq!(command(end(1, play, Some(0), None)), one("StackExited", "command"));
    assert_eq!(command(end(1, drain, Some(3), None)), one("StackCrashed", "command"));
    assert_eq!(command(end(1, drain, None, Some(11))), one("StackCrashed", "command"));
}

#[test]
fn a_helper_counts_only_when_a_signal_that_nobody_sends_ended_it() {
    let begun = Instant::now();
    let at = begun + Duration::from_secs(5);
    for (signal, counts) in [(11, true), (9, true), (6, true), (13, false), (15, false), (2, false)]
    {
        let reported = judged(&[end(4, at, None, Some(signal))], None, begun);
        assert_eq!(!reported.is_empty(), counts, "signal {signal}");
    }
    assert_eq!(judged(&[end(4, at, Some(1), None)], None, begun), []);
    assert_eq!(judged(&[end(4, at, None, None)], None, begun), []);
}

#[test]
fn a_node_that_was_gone_before_is_not_held_to_a_late_notice() {
    let begun = Instant::now();
    let late = [end(7, begun + Duration::from_secs(15), None, Some(11))];
    let course = course(begun);
    let with = |found: Found| {
        let nodes = vec![(node(7), found)];
        let facts = Facts { after: &late, nodes, course: &course, ..Facts::default() };
        facts.evidence().len()
    };
    assert_eq!((with(Found::Unreachable), with(Found::Same)), (1, 0));
    assert_eq!(
        warnings(&late),
        ["python3 was ended by signal 11 (SIGSEGV) when it was asked to end, after the case"]
    );
    assert!(warnings(&[end(7, begun, None, Some(15))]).is_empty());
}

#[test]
fn one_that_leaves_after_the_last_input_may_be_slow_at_it() {
    let begun = Instant::now();
    let course = course(begun);
    let late = [end(7, begun + Duration::from_secs(15), None, Some(2))];
    let with = |stayed: bool, found: Found| {
        let nodes = vec![(Known { stayed, ..node(7) }, found)];
        let facts = Facts { after: &late, nodes, course: &course, ..Facts::default() };
        facts.evidence().into_iter().map(|end| end.cause.name()).collect::<Vec<_>>()
    };
    assert!(with(true, Found::Unregistered).is_empty());
    assert_eq!(with(false, Found::Unregistered), ["NodeGone"]);
    assert_eq!(with(true, Found::Unreachable), ["NodeGone"]);
}

#[test]
fn a_node_that_left_is_gone_however_its_process_ends_when_it_is_asked_to() {
    let begun = Instant::now();
    let course = course(begun);
    let (at, drain) = (begun + Duration::from_secs(20), begun + Duration::from_secs(14));
    let with = |end: ProcessEnd, found: Found, asked: bool| {
        let (before, after) = if asked { (vec![], vec![end]) } else { (vec![end], vec![]) };
        let nodes = vec![(node(7), found)];
        let facts =
            Facts { ends: &before, after: &after, nodes, course: &course, ..Facts::default() };
        facts.evidence().into_iter().map(|end| (end.message, end.bag_seconds)).collect::<Vec<_>>()
    };
    let gone = [("the node /tracker is gone from the ROS graph".to_owned(), None)];
    // SIGINT, which it takes as a wish to end; the agent's SIGKILL is not its own end either.
    for (status, signal) in
        [(Some(0), None), (Some(1), None), (None, Some(9)), (None, Some(11)), (None, None)]
    {
        assert_eq!(with(end(7, at, status, signal), Found::Unregistered, true), gone);
        let again = "the node /tracker was registered again, and another process has its name now";
        let another = with(end(7, at, status, signal), Found::Another, true);
        assert_eq!(another, [(again.to_owned(), None)]);
    }
    assert_eq!(with(end(7, at, None, Some(9)), Found::Unreachable, true), gone);
    // By itself, once it had everything.
    assert_eq!(with(end(7, drain, Some(0), None), Found::Unregistered, false), []);
    // Its own end too, of which the notice came late.
    assert_eq!(with(end(7, at, Some(0), None), Found::Unreachable, true), []);
}

#[test]
fn one_that_is_done_and_breaks_when_it_is_asked_to_end_is_done() {
    let begun = Instant::now();
    let course = course(begun);
    for (status, signal) in [(Some(1), None), (None, Some(11))] {
        let after = [end(7, begun + Duration::from_secs(20), status, signal)];
        let nodes = vec![(Known { stayed: true, ..node(7) }, Found::Unregistered)];
        let facts = Facts { after: &after, nodes, course: &course, ..Facts::default() };
        assert!(facts.evidence().is_empty());
        assert_eq!(facts.left(), ["/tracker"]);
    }
}

#[test]
fn a_node_whose_process_ended_midway_did_not_stay() {
    let begun = Instant::now();
    let course = course(begun);
    // Its name was there when all input was out: another process had it by then.
    let ends = [end(7, begun + Duration::from_secs(5), Some(0), None)];
    let nodes = vec![(Known { stayed: true, ..node(7) }, Found::Unregistered)];
    let facts = Facts { ends: &ends, nodes, course: &course, ..Facts::default() };
    let causes: Vec<&str> = facts.evidence().iter().map(|end| end.cause.name()).collect();
    assert_eq!(causes, ["NodeGone"]);
}

#[test]
fn who_leaves_after_the_last_input_and_lives_on_is_named() {
    let begun = Instant::now();
    let course = course(begun);
    let ends = [end(7, begun + Duration::from_secs(14), Some(0), None)];
    let with = |stayed: bool, found: Found, ends: &[ProcessEnd]| {
        let nodes = vec![(Known { stayed, ..node(7) }, found)];
        Facts { ends, nodes, course: &course, ..Facts::default() }.left()
    };
    assert_eq!(with(true, Found::Unregistered, &[]), ["/tracker"]);
    // When a process ended is known to the moment.
    assert!(with(true, Found::Unregistered, &ends).is_empty());
    // Evidence by itself.
    assert!(with(false, Found::Unregistered, &[]).is_empty());
    assert!(with(true, Found::Same, &[]).is_empty());
}

#[test]
fn the_sentence_has_the_second_of_bag_time_and_the_last_line() {
    let begun = Instant::now();
    let ends = [end(7, begun + Duration::from_millis(7500), None, Some(11))];
    let course = course(begun);
    let facts = Facts {
        ends: &ends,
        nodes: vec![(node(7), Found::Unregistered)],
        course: &course,
        last_line: Some("boom"),
        ..Facts::default()
    };
    let reported = &facts.evidence()[0];
    assert_eq!(
        (reported.bag_seconds, reported.signal, reported.exit_status),
        (Some(4.5), Some(11), None)
    );
    assert_eq!(
        reported.message,
        "the node /tracker was ended by signal 11 (SIGSEGV) at 4.5 s of the window; the stack's \
         last line on stderr: boom"
    );
    assert_eq!(facts.bag_seconds(begun + Duration::from_secs(2)), Some(-1.0));
}

/// The sentences on ends, where a node of process 7 had left when the play began.
fn judged_without(ends: &[ProcessEnd], nodes: Vec<(Known, Found)>, begun: Instant) -> Vec<String> {
    let course = course(begun);
    let command = Some((1, "roslaunch"));
    let before = Before { met: vec![node(7)], ..Before::default() };
    let facts = Facts { command, ends, nodes, before, course: &course, ..Facts::default() };
    let all = facts.evidence().into_iter();
    all.map(|end| format!("{}: {}", end.cause.name(), end.message)).collect()
}

#[test]
fn a_node_that_ended_badly_before_the_play_is_a_crash() {
    let begun = Instant::now();
    let before = begun + Duration::from_millis(500);
    let without = |end: ProcessEnd| judged_without(&[end], Vec::new(), begun);
    assert_eq!(
        without(end(7, before, Some(1), None)),
        ["StackCrashed: the node /tracker ended with exit status 1 before the play began"]
    );
    assert_eq!(
        without(end(7, before, None, Some(11))),
        ["StackCrashed: the node /tracker was ended by signal 11 (SIGSEGV) before the play began"]
    );
    // It may have left the graph, and end later.
    let later = begun + Duration::from_secs(5);
    assert_eq!(
        without(end(7, later, Some(1), None)),
        ["StackCrashed: the node /tracker ended with exit status 1 at 2.0 s of the window"]
    );
    // Its work was done, or a script has ended it; of another process it is not known that it was a node.
    assert!(without(end(7, before, Some(0), None)).is_empty());
    assert!(without(end(7, before, None, Some(15))).is_empty());
    assert!(without(end(7, before, Some(143), None)).is_empty());
    assert!(without(end(7, before, None, None)).is_empty());
    assert!(without(end(4, before, Some(1), None)).is_empty());
}

#[test]
fn an_end_is_reported_once_also_of_a_process_of_two_nodes() {
    let begun = Instant::now();
    let ends = [end(7, begun + Duration::from_secs(5), Some(1), None)];
    let there = Known { name: "/planner".to_owned(), ..node(7) };
    let nodes = vec![(there, Found::Unregistered)];
    assert_eq!(
        judged_without(&ends, nodes, begun),
        ["StackCrashed: the node /planner ended with exit status 1 at 2.0 s of the window"]
    );
}

#[test]
fn a_node_that_ended_before_the_play_and_took_no_leave_is_gone_unless_it_is_known_how() {
    let begun = Instant::now();
    let before = begun + Duration::from_millis(500);
    let course = course(begun);
    let with = |ends: &[ProcessEnd]| {
        let met = vec![Known { stayed: true, ..node(7) }];
        let before = Before { met, ..Before::default() };
        let facts = Facts { ends, before, course: &course, ..Facts::default() };
        facts.evidence().into_iter().map(|end| end.cause).collect::<Vec<_>>()
    };
    assert_eq!(with(&[end(7, before, None, None)]), [Cause::NodeGone]);
    assert_eq!(with(&[]), [Cause::NodeGone]);
    assert_eq!(with(&[end(7, before, None, Some(15))]), []);
    assert_eq!(with(&[end(7, before, Some(1), None)]), [Cause::StackCrashed]);
}

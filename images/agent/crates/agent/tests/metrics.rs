//! GET /metrics of `serve`: its figures during cases and after them, for Prometheus' own reader,
//! and what hostile peers of it can do, which is nothing.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod worker;

use std::cell::Cell;
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rmpv::Value;
use worker::exec::{exec_case, run};
use worker::*;

/// An agent with its endpoint.
struct Watched {
    agent: Agent,
    address: String,
}

impl Watched {
    fn start(slots: u32) -> Watched {
        let address = format!("127.0.0.1:{}", free_ports(1));
        let agent = Agent::start_with(slots, &["--metrics", &address], |_| {});
        Watched { agent, address }
    }

    /// The answer to a request, head and all.
    fn ask(&self, request: &[u8]) -> String {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(LONG)).unwrap();
        stream.write_all(request).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    fn page(&self) -> String {
        let answer = self.ask(b"GET /metrics HTTP/1.1\r\nHost: agent\r\n\r\n");
        let (head, page) = answer.split_once("\r\n\r\n").unwrap();
        assert!(head.starts_with("HTTP/1.1 200 OK\r\n"), "{head}");
        assert!(head.contains("Content-Type: text/plain; version=0.0.4; charset=utf-8"), "{head}");
        page.to_owned()
    }

    fn figures(&self) -> Figures {
        let page = self.page();
        let samples = page.lines().filter(|line| !line.starts_with('#'));
        let split = |line: &str| {
            let (name, value) = line.rsplit_once(' ').unwrap();
            (name.strip_prefix("bagpipe_agent_").unwrap().to_owned(), value.parse().unwrap())
        };
        Figures(samples.map(split).collect())
    }

    /// The figures once `so` holds of them.
    fn once(&self, what: &str, so: impl Fn(&Figures) -> bool) -> Figures {
        let last = Cell::new(None);
        until(what, Duration::from_secs(60), || {
            let figures = self.figures();
            let holds = so(&figures);
            last.set(Some(figures));
            holds
        });
        last.take().unwrap()
    }

    /// Bytes that `serve` itself has in memory, and its threads.
    fn weight(&self) -> (u64, u64) {
        let path = format!("/proc/{}/status", self.agent.process.id());
        let status = std::fs::read_to_string(path).unwrap();
        let number = |key: &str| {
            let line = status.lines().find(|line| line.starts_with(key)).unwrap();
            line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap()
        };
        (number("VmRSS:") * 1024, number("Threads:"))
    }
}

struct Figures(BTreeMap<String, f64>);

impl Figures {
    fn of(&self, name: &str) -> f64 {
        *self.0.get(name).unwrap_or_else(|| panic!("{name} of {:?}", self.0))
    }

    fn ended(&self) -> [f64; 3] {
        ["answered", "aborted", "abandoned"]
            .map(|outcome| self.of(&format!("cases_ended_total{{outcome=\"{outcome}\"}}")))
    }

    fn ledger(&self) -> [f64; 3] {
        ["sent", "received", "dropped"]
            .map(|counted| self.of(&format!("ledger_messages_total{{counted=\"{counted}\"}}")))
    }
}

/// What Prometheus' own checker says of a page; nothing if it is fine.
fn judged(page: &str) -> Option<String> {
    let mut program = Command::new("promtool")
        .args(["check", "metrics"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("promtool is needed: `make preflight-all` installs it");
    program.stdin.take().unwrap().write_all(page.as_bytes()).unwrap();
    let output = program.wait_with_output().unwrap();
    let words = [output.stdout, output.stderr].concat();
    let fine = output.status.success() && words.is_empty();
    (!fine).then(|| String::from_utf8_lossy(&words).into_owned())
}

/// A case of [`chatter`], which begins at second 100.
fn with_playback(case: Value, playback: Value) -> Value {
    let Value::Map(mut case) = case else { panic!("a case is a map") };
    case.retain(|(key, _)| !matches!(key.as_str(), Some("playback" | "window")));
    case.push(("playback".into(), playback));
    case.push(("window".into(), window(100_000_000_000, 200_000_000_000)));
    Value::Map(case)
}

#[test]
fn the_reference_is_what_an_idle_agent_says_and_prometheus_reads_it() {
    let watched = Watched::start(1);
    let page = watched.page();
    // docs/reference/metrics.md is made from it.
    let reference = format!("{}/metrics.txt", std::env::var("CARGO_MANIFEST_DIR").unwrap());
    if std::env::var_os("BAGPIPE_WRITE_REFERENCE").is_some() {
        std::fs::write(&reference, &page).unwrap();
    }
    let written = std::fs::read_to_string(&reference).unwrap_or_default();
    assert!(written == page, "{reference} is not what the agent says:\n{page}");
    assert_eq!(judged(&page), None);
    assert!(watched.ask(b"GET / HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 404 "));
    assert!(watched.ask(b"POST /metrics HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 405 "));
}

#[test]
fn a_replay_is_seen_while_it_runs_and_counted_when_it_has_ended() {
    if without_ros() {
        return;
    }
    let watched = Watched::start(2);
    let bag = chatter(300);
    let rate: f64 = 0.25;
    let playback = map(&[("mode", "realtime".into()), ("rate", rate.into())]);
    let mut link = watched.agent.greet(0, with_playback(watched.agent.case(ECHO, &[]), playback));
    let greeted = watched.once("busy", |now| now.of("slots_busy") == 1.0);
    assert_eq!((greeted.of("slots"), greeted.ended()), (2.0, [0.0; 3]));
    assert!(greeted.of("pipe_size_bytes") >= 4096.0);
    feed(&mut link, &bag);
    let playing = watched.once("playing", |now| {
        now.of("played_messages_total") > 0.0 && now.of("recorded_bytes_total") > 0.0
    });
    // It plays for twelve seconds, and its progress is reported twice a second.
    assert!(playing.of("played_messages_total") < 300.0);
    assert_eq!(playing.of("fragment_received_bytes_total"), bag.len() as f64);
    assert!(playing.of("recordings_size_bytes") > 0.0);
    assert_eq!((playing.ledger(), playing.ended()), ([0.0; 3], [0.0; 3]));
    let (result, recorded) = answer(&mut link).result();
    drop(link);
    let after = watched.once("ended", |now| now.ended() == [1.0, 0.0, 0.0]);
    assert_eq!((after.of("slots_busy"), after.ledger()), (0.0, [300.0, 300.0, 0.0]));
    assert_eq!(after.of("played_messages_total"), 300.0);
    assert_eq!(after.of("recorded_messages_total"), 300.0);
    let number = |path| at(&result, path).as_f64().unwrap();
    assert_eq!(after.of("recorded_bytes_total"), number("recorded.bytes"));
    assert_eq!(after.of("recorder_high_water_bytes"), number("recorded.high_water_bytes"));
    assert!(after.of("recorder_high_water_bytes") >= recorded.len() as f64);
    assert_eq!(after.of("recordings_size_bytes"), 0.0);
    // From the first message to the last one there are 2.99 s of bag time.
    let (played, due) =
        (after.of("replay_bag_seconds_total"), after.of("replay_due_seconds_total"));
    assert!((played - 2.99).abs() < 1e-6, "{played}");
    // What is due grows from the window's beginning to the drain, which is longer than the play by
    // what a busy machine takes.
    let most = number("timings.play") + number("timings.drain");
    let spent = due / rate;
    let possible = number("playback.played_seconds") - 1e-6..=most + 1e-6;
    assert!(possible.contains(&spent), "{due} due in {spent} s, by RESULT in {possible:?} s");
    assert_eq!(after.of("replay_unpaced_bag_seconds_total"), 0.0);
    assert_eq!(judged(&watched.page()), None);
}

#[test]
fn each_wait_of_lockstep_is_counted() {
    if without_ros() {
        return;
    }
    let watched = Watched::start(1);
    let step = |answer: &str, deadline: f64| {
        map(&[
            ("trigger", "/chatter".into()),
            ("answer", answer.into()),
            ("deadline", deadline.into()),
        ])
    };
    let play = |answer: &str, deadline: f64, count: u64| {
        let steps = Value::Array(vec![step(answer, deadline)]);
        let playback = map(&[("mode", "lockstep".into()), ("steps", steps)]);
        let case = with_playback(watched.agent.case(ECHO, &[]), playback);
        watched.agent.run(0, case, &chatter(count)).result().0
    };
    let result = play("/echo", 60.0, 120);
    let after = watched.once("ended", |now| now.ended()[0] == 1.0);
    let waits = "lockstep_wait_seconds";
    assert_eq!(after.of(&format!("{waits}_count")), 120.0);
    assert_eq!(after.of(&format!("{waits}_bucket{{le=\"+Inf\"}}")), 120.0);
    let waited = at(&result, "playback.steps.0.waited_seconds").as_f64().unwrap();
    assert!((after.of(&format!("{waits}_sum")) - waited).abs() < 1e-6);
    assert_eq!(after.of("lockstep_unanswered_total"), 0.0);
    assert!((after.of("replay_unpaced_bag_seconds_total") - 1.19).abs() < 1e-6);
    assert_eq!(after.of("replay_due_seconds_total"), 0.0);
    // A deadline that no answer can meet.
    let result = play("/echo", 0.0, 20);
    let after = watched.once("ended", |now| now.ended()[0] == 2.0);
    let missed = at(&result, "playback.steps.0.no_output").as_f64().unwrap();
    assert_eq!(after.of("lockstep_unanswered_total"), missed);
    assert!(missed > 0.0);
}

#[test]
fn what_a_process_counted_outlives_it_and_a_case_that_dies_with_it_is_abandoned() {
    let watched = Watched::start(1);
    let input = vec![7; 300_000];
    assert!(run(&watched.agent, "exec cat", &[], &input).abort.is_none());
    assert!(run(&watched.agent, "exit 3", &[], b"in").abort.is_some());
    let counted = watched.once("both", |now| now.ended() == [1.0, 1.0, 0.0]);
    let received = counted.of("fragment_received_bytes_total");
    assert!((300_000.0..=300_002.0).contains(&received), "{received}");
    let link = watched.agent.greet(0, exec_case(&watched.agent, "sleep 60", &[]));
    watched.once("busy", |now| now.of("slots_busy") == 1.0);
    let [slot] = watched.agent.slot_processes()[..] else { panic!("one slot") };
    let slot = rustix::process::Pid::from_raw(slot.cast_signed()).unwrap();
    rustix::process::kill_process(slot, rustix::process::Signal::KILL).unwrap();
    let after = watched.once("died", |now| now.of("slot_deaths_total") == 1.0);
    drop(link);
    assert_eq!((after.ended(), after.of("slots_busy")), ([1.0, 1.0, 1.0], 0.0));
    assert_eq!(after.of("fragment_received_bytes_total"), received);
    until("ready again", Duration::from_secs(60), || {
        let listening = watched.agent.slot_processes();
        listening != [slot.as_raw_nonzero().get().cast_unsigned()]
    });
    assert!(run(&watched.agent, "exec cat", &[], &input).abort.is_none());
    let again = watched.once("again", |now| now.ended() == [2.0, 1.0, 1.0]);
    assert_eq!(again.of("fragment_received_bytes_total"), received + 300_000.0);
}

#[test]
fn hostile_peers_hold_up_no_case_and_take_no_memory() {
    let watched = Watched::start(1);
    watched.page();
    let (before, _) = watched.weight();
    let endless = [&b"GET /metrics HTTP/1.1\r\nX: "[..], &vec![b'x'; 1 << 20]].concat();
    let mut held = Vec::new();
    for request in [
        &b""[..],
        b"GET /metr",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"POST /metrics HTTP/1.1\r\nContent-Length: 999999999\r\n\r\n",
        &endless,
    ] {
        for _ in 0..8 {
            let mut stream = TcpStream::connect(&watched.address).unwrap();
            stream.set_nonblocking(true).unwrap();
            // Whoever is not served yet may find the socket full.
            let _full = stream.write(request);
            held.push(stream);
        }
    }
    let begun = Instant::now();
    let given = run(&watched.agent, "exec cat", &[], &vec![1; 2_000_000]);
    let took = begun.elapsed();
    assert!(given.abort.is_none(), "{:?}", given.abort);
    assert!(took < Duration::from_secs(20), "{took:?}");
    let (during, threads) = watched.weight();
    assert!(during < before + (8 << 20), "{before} bytes grew to {during}");
    // The main one, the one that accepts, and one for each connection that is served.
    assert!(threads <= 2 + 8, "{threads} threads");
    let after = watched.once("counted", |now| now.ended() == [1.0, 0.0, 0.0]);
    assert_eq!(after.of("fragment_received_bytes_total"), 2_000_000.0);
    drop(held);
}

#[test]
fn cases_run_where_the_port_is_taken() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let agent = Agent::start_with(1, &["--metrics", &address], |_| {});
    assert!(run(&agent, "exec cat", &[], b"some bytes").abort.is_none());
}

#[test]
fn nobody_listens_unless_asked_to() {
    let agent = Agent::start(1);
    assert!(run(&agent, "exec cat", &[], b"some bytes").abort.is_none());
    let descriptors = Path::new("/proc").join(agent.process.id().to_string()).join("fd");
    let sockets = std::fs::read_dir(descriptors).unwrap().flatten().filter(|entry| {
        std::fs::read_link(entry.path()).is_ok_and(|to| to.to_string_lossy().starts_with("socket:"))
    });
    assert_eq!(sockets.count(), 0);
}

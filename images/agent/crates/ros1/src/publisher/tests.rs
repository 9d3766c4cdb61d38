use std::io::Read;
use std::net::TcpListener;
use std::sync::atomic::{AtomicU32, Ordering};

use super::*;

/// A connection over loopback: ours, and the subscriber's. What the kernel keeps for that one would grow with what it
/// reads, on some machines to more than a large message.
fn connection() -> (TcpStream, TcpStream) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let theirs = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
    rustix::net::sockopt::set_socket_recv_buffer_size(&theirs, 1 << 20).unwrap();
    (listener.accept().unwrap().0, theirs)
}

/// A frame of so many bytes of one value.
fn frame(length: usize, value: u8) -> Vec<u8> {
    [&(length as u32).to_le_bytes()[..], &vec![value; length]].concat()
}

fn header(node: &str) -> ConnectionHeader {
    ConnectionHeader::new().with("callerid", node)
}

/// A frame's length and value, or none at the connection's end.
fn next_frame(mut stream: &TcpStream) -> Option<(u32, u8)> {
    let mut length = [0; 4];
    stream.read_exact(&mut length).ok()?;
    let mut bytes = vec![0; u32::from_le_bytes(length) as usize];
    stream.read_exact(&mut bytes).ok().map(|()| (bytes.len() as u32, bytes[0]))
}

#[test]
fn who_reads_the_latched_messages_slowly_keeps_no_message_from_others() {
    let info = TopicInfo { topic: "/map".to_owned(), latching: true, ..TopicInfo::default() };
    let publication = Publication::new(info, Duration::from_secs(60));
    let map = 64 << 20;
    publication.latch("/mapper", Share::LeadIn, &frame(map, 1));
    let (slow, reads_late) = connection();
    let (quick, reads_at_once) = connection();
    let frames = |stream: &TcpStream| std::iter::from_fn(|| next_frame(stream)).collect::<Vec<_>>();
    let (before, after, quickly, late) = std::thread::scope(|scope| {
        let quickly = scope.spawn(|| frames(&reads_at_once));
        publication.welcome("/player", &header("/quick"), quick).unwrap();
        let slowly = scope.spawn(|| publication.welcome("/player", &header("/slow"), slow));
        next_frame(&reads_late).expect("a greeting");
        reads_late.peek(&mut [0]).expect("the map's first byte");
        publication.latch("/mapper", Share::Counted, &frame(8, 2));
        publication.send(Share::Counted, &[&frame(8, 2)], &mut || false).unwrap();
        let before = publication.subscribers();
        let late = scope.spawn(|| frames(&reads_late));
        slowly.join().unwrap().unwrap();
        publication.send(Share::Counted, &[&frame(8, 3)], &mut || false).unwrap();
        let after = publication.subscribers();
        lock(&publication.links).all.clear();
        (before, after, quickly.join().unwrap(), late.join().unwrap())
    });
    let counts = |links: Vec<LinkState>| {
        links.into_iter().map(|link| (link.id, link.lead_in, link.counted)).collect::<Vec<_>>()
    };
    assert_eq!(counts(before), [(1, 1, 1)], "one of two has read the map");
    assert_eq!(counts(after), [(1, 1, 2), (2, 1, 2)]);
    let expected = [(map as u32, 1), (8, 2), (8, 3)];
    assert_eq!((&quickly[1..], &late[..]), (&expected[..], &expected[..]));
}

#[test]
fn who_reads_on_more_slowly_than_is_latched_misses_only_what_came_behind_the_first() {
    let info = TopicInfo { topic: "/map".to_owned(), latching: true, ..TopicInfo::default() };
    let publication = Publication::new(info, Duration::from_secs(60));
    let size = 16 << 20;
    let latch = |value| {
        let bytes = frame(size, value);
        publication.latch("/mapper", Share::Counted, &bytes);
        publication.send(Share::Counted, &[&bytes], &mut || false).unwrap();
    };
    latch(1);
    let (slow, reads_late) = connection();
    reads_late.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let begins = || reads_late.peek(&mut [0]).expect("another message");
    let values = std::thread::scope(|scope| {
        let welcomed = scope.spawn(|| publication.welcome("/player", &header("/slow"), slow));
        next_frame(&reads_late).expect("a greeting");
        begins();
        latch(2);
        let mut got = vec![next_frame(&reads_late).unwrap().1];
        // Of what was latched meanwhile it has the first byte, and no more.
        begins();
        let played = scope.spawn(|| (3..6).for_each(latch));
        got.extend((0..4).map(|_| next_frame(&reads_late).unwrap().1));
        played.join().unwrap();
        welcomed.join().unwrap().unwrap();
        got
    });
    assert_eq!(values, [1, 2, 3, 4, 5]);
}

#[test]
fn who_reads_what_came_behind_the_first_in_drops_is_waited_for_no_longer_than_who_stops() {
    let info = TopicInfo { topic: "/map".to_owned(), latching: true, ..TopicInfo::default() };
    let publication = Publication::new(info, Duration::from_secs(5));
    let (size, read_at_once) = (32 << 20, 32 << 10);
    let second = frame(size, 2);
    publication.latch("/mapper", Share::Counted, &frame(size, 1));
    let (slow, mut reads_late) = connection();
    reads_late.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let welcomed = std::thread::scope(|scope| {
        let welcomed = scope.spawn(|| publication.welcome("/player", &header("/slow"), slow));
        next_frame(&reads_late).expect("a greeting");
        reads_late.peek(&mut [0]).expect("the first message");
        publication.latch("/mapper", Share::Counted, &second);
        assert_eq!(next_frame(&reads_late), Some((size as u32, 1)));
        let mut bytes = vec![0; read_at_once];
        // Twenty seconds for all of it, and none without a byte.
        while !welcomed.is_finished() && reads_late.read(&mut bytes).is_ok_and(|read| read > 0) {
            std::thread::sleep(Duration::from_millis(20));
        }
        welcomed.join().unwrap()
    });
    assert_eq!(welcomed.unwrap_err(), "it did not read the latched messages");
    assert!(publication.subscribers().is_empty());
}

#[test]
fn a_play_that_is_cancelled_does_not_wait_for_who_reads_what_is_latched() {
    let info = TopicInfo { topic: "/map".to_owned(), latching: true, ..TopicInfo::default() };
    let publication = Publication::new(info, Duration::from_secs(60));
    let size = 32 << 20;
    publication.latch("/mapper", Share::Counted, &frame(size, 1));
    let (slow, reads_late) = connection();
    reads_late.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    std::thread::scope(|scope| {
        let welcomed = scope.spawn(|| publication.welcome("/player", &header("/slow"), slow));
        next_frame(&reads_late).expect("a greeting");
        reads_late.peek(&mut [0]).expect("the first message");
        publication.latch("/mapper", Share::Counted, &frame(size, 2));
        assert_eq!(next_frame(&reads_late), Some((size as u32, 1)));
        // Of the second it reads nothing.
        reads_late.peek(&mut [0]).expect("the second message");
        let sent = publication.send(Share::Counted, &[&frame(8, 3)], &mut || true);
        let awaited = publication.await_unread(0, &mut || true);
        let is_still_welcomed = !welcomed.is_finished();
        drop(reads_late);
        assert!(is_still_welcomed);
        assert!(matches!(sent, Err(SendError::Cancelled)), "{sent:?}");
        assert!(matches!(awaited, Err(SendError::Cancelled)), "{awaited:?}");
    });
}

#[test]
fn who_has_read_everything_is_not_who_has_stopped() {
    let info = TopicInfo { topic: "/map".to_owned(), ..TopicInfo::default() };
    let publication = Publication::new(info, Duration::from_millis(100));
    let (quick, reads_at_once) = connection();
    let (slow, reads_nothing) = connection();
    publication.welcome("/player", &header("/quick"), quick).unwrap();
    publication.welcome("/player", &header("/slow"), slow).unwrap();
    publication.send(Share::Counted, &[&frame(1000, 1)], &mut || false).unwrap();
    let greeting = next_frame(&reads_at_once);
    assert_eq!((greeting.is_some(), next_frame(&reads_at_once)), (true, Some((1000, 1))));
    let why = publication.await_unread(0, &mut || false).unwrap_err();
    let SendError::Stalled { node, .. } = why else { panic!("{why:?}") };
    assert_eq!(node, "/slow");
    drop(reads_nothing);
}

#[test]
fn who_reads_late_has_held_up_the_play_from_the_first_counted_message_on() {
    let info = TopicInfo { topic: "/map".to_owned(), ..TopicInfo::default() };
    let publication = Publication::new(info, Duration::from_secs(60));
    let (quick, reads_at_once) = connection();
    let (slow, reads_late) = connection();
    publication.welcome("/player", &header("/quick"), quick).unwrap();
    publication.welcome("/player", &header("/slow"), slow).unwrap();
    for stream in [&reads_at_once, &reads_late] {
        next_frame(stream).expect("a greeting");
    }
    let held = |share| {
        // As small as any socket takes at once.
        publication.send(share, &[&frame(1000, 1)], &mut || false).unwrap();
        next_frame(&reads_at_once).expect("the message");
        let asked = AtomicU32::new(0);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while asked.load(Ordering::Relaxed) < 5 {
                    std::thread::yield_now();
                }
                next_frame(&reads_late)
            });
            let mut ask = || {
                asked.fetch_add(1, Ordering::Relaxed);
                false
            };
            publication.await_unread(0, &mut ask).unwrap();
        });
        let held: Vec<Duration> =
            publication.subscribers().into_iter().map(|link| link.held_up).collect();
        (held[0], held[1])
    };
    assert_eq!(held(Share::LeadIn), (Duration::ZERO, Duration::ZERO));
    let (quick, slow) = held(Share::Counted);
    assert!(quick.is_zero() && slow > Duration::ZERO, "{quick:?} {slow:?}");
}

#[test]
fn who_takes_no_byte_is_waited_for_as_long_as_the_limit_and_no_longer() {
    let info = TopicInfo { topic: "/talk".to_owned(), ..TopicInfo::default() };
    let stall = Duration::from_millis(200);
    let publication = Publication::new(info, stall);
    let (deaf, _reads_nothing) = connection();
    publication.welcome("/player", &header("/deaf"), deaf).unwrap();
    let mut asked = 0;
    let mut ask = || {
        asked += 1;
        false
    };
    let sent = publication.send(Share::Counted, &[&frame(16 << 20, 1)], &mut ask);
    let Err(SendError::Stalled { node, topic, waited, .. }) = sent else { panic!("{sent:?}") };
    assert_eq!((node.as_str(), topic.as_str()), ("/deaf", "/talk"));
    assert!(waited >= stall, "{waited:?}");
    // Each question is followed by a wait of 20 ms, on a machine that stands still by a longer one. What
    // the kernel takes at first, it may take in several goes.
    let most = stall.div_duration_f64(LOOK) as u32 + 20;
    assert!((1..=most).contains(&asked), "{asked} questions");
}

#[test]
fn a_partial_write_continues_inside_the_right_frame() {
    let frames: [&[u8]; 3] = [b"aaaa", b"bb", b"cccccc"];
    assert_eq!(advance(&frames, 3), (&frames[..], 3));
    assert_eq!(advance(&frames, 4), (&frames[1..], 0));
    assert_eq!(advance(&frames, 7), (&frames[2..], 1));
    assert_eq!(advance(&frames, 12), (&frames[3..], 0));
}

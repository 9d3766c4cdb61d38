//! The order of a lock-step recording, which does not depend on when a thread woke up.
//!
//! Outputs are held until simulated time moves on, and are then written by topic, then by
//! publisher, then in the order in which the publisher sent them. All else that a bag
//! keeps of a run is its publishers' names: anonymous ones carry the process id and the
//! time of day, which are taken out.

use std::sync::Arc;

use bagpipe_log::Connection;

/// An output that is held.
#[derive(Debug)]
pub(crate) struct Held {
    pub(crate) connection: Arc<Connection>,
    /// Its number among all outputs; only its order within one connection counts.
    pub(crate) number: u64,
    pub(crate) data: Vec<u8>,
}

/// Outputs of one simulated time.
#[derive(Debug, Default)]
pub(crate) struct Hold {
    held: Vec<Held>,
    bytes: u64,
    number: u64,
}

impl Hold {
    pub(crate) fn push(&mut self, connection: Arc<Connection>, data: &[u8]) {
        self.number += 1;
        self.bytes += data.len() as u64;
        self.held.push(Held { connection, number: self.number, data: data.to_vec() });
    }

    /// Bytes that are held.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Lets go of everything, in order.
    pub(crate) fn release(&mut self) -> Vec<Held> {
        self.bytes = 0;
        let mut held = std::mem::take(&mut self.held);
        held.sort_by(|a, b| {
            let key =
                |held: &Held| (held.connection.topic.clone(), held.connection.caller_id.clone());
            key(a).cmp(&key(b)).then(a.number.cmp(&b.number))
        });
        held
    }
}

/// A publisher's name without what differs between two runs: roscpp's anonymous names end
/// in `_<nanoseconds>`, rospy's in `_<pid>_<milliseconds>`, roslaunch's in
/// `_<host>_<pid>_<random number>`.
pub(crate) fn settled_name(caller: &str) -> String {
    const ANONYMOUS: &str = "_anonymous";
    let Some((front, last)) = number_at_end(caller) else { return caller.to_owned() };
    match number_at_end(front) {
        Some((name, pid)) if pid.len() <= 7 && last.len() >= 13 => format!("{name}{ANONYMOUS}"),
        _ if last.len() >= 16 => format!("{front}{ANONYMOUS}"),
        _ => caller.to_owned(),
    }
}

fn number_at_end(name: &str) -> Option<(&str, &str)> {
    let (front, last) = name.rsplit_once('_')?;
    let digits = !last.is_empty() && last.bytes().all(|byte| byte.is_ascii_digit());
    digits.then_some((front, last))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn anonymous_names_lose_what_differs_between_runs_and_others_lose_nothing() {
        assert_eq!(settled_name("/talker_1763617212345678901"), "/talker_anonymous");
        assert_eq!(settled_name("/talker_4711_1763617212345"), "/talker_anonymous");
        assert_eq!(settled_name("/n_box_4711_7238472384723847238"), "/n_box_anonymous");
        for name in ["/talker", "/camera_2", "/lane_2024_11", "/a_20241120"] {
            assert_eq!(settled_name(name), name);
        }
    }

    #[test]
    fn topics_and_publishers_come_in_order_and_each_one_keeps_its_own() {
        let connection = |topic: &str, caller: &str| {
            Arc::new(Connection {
                topic: topic.to_owned(),
                datatype: String::new(),
                md5sum: String::new(),
                definition: "".into(),
                caller_id: Some(caller.to_owned()),
                ..Connection::default()
            })
        };
        let (a1, a2, b) = (connection("/a", "/1"), connection("/a", "/2"), connection("/b", "/1"));
        let mut hold = Hold::default();
        for (from, data) in [(&b, 1), (&a2, 2), (&a1, 9), (&a2, 1), (&a1, 3)] {
            hold.push(Arc::clone(from), &[data]);
        }
        assert_eq!(hold.bytes(), 5);
        let order: Vec<u8> = hold.release().iter().map(|held| held.data[0]).collect();
        assert_eq!(order, [9, 3, 2, 1, 1]);
        assert_eq!((hold.bytes(), hold.release().len()), (0, 0));
    }
}

//! Quality of service, and names of message types.

use std::time::Duration;

use crate::PlayerError;

/// How many messages a queue keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum History {
    /// The last ones, so many; at least one.
    KeepLast(u32),
    /// All, as far as the middleware's limits go.
    KeepAll,
}

/// Whether lost messages are sent again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Reliability {
    /// They are.
    Reliable,
    /// They are not.
    BestEffort,
}

/// Whether late subscribers get earlier messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Durability {
    /// They don't.
    Volatile,
    /// They do, as far as the publisher's history goes.
    TransientLocal,
}

/// How often an endpoint publishes, and shows that it is there: a publisher promises it, a subscription
/// asks for it, and matches none that promises less. A time that nobody sets is without end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Presence {
    /// The longest time between two messages.
    pub deadline: Option<Duration>,
    /// The longest time without a sign of the publisher.
    pub lease: Option<Duration>,
    /// Whether only the program gives that sign, as by publishing, and not its middleware by itself.
    pub manual: bool,
}

impl Presence {
    /// Nothing is promised or asked for.
    pub const NONE: Presence = Presence { deadline: None, lease: None, manual: false };
}

/// Quality of service of a publisher or a subscription; all else is rcl's default.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Qos {
    /// How many messages are kept.
    pub history: History,
    /// Whether lost messages are sent again.
    pub reliability: Reliability,
    /// Whether late subscribers get earlier messages.
    pub durability: Durability,
    /// How often it publishes, and shows that it is there.
    pub presence: Presence,
}

impl Qos {
    /// History, depth, reliability and durability by rmw's numbers; then the deadline and the lease, in ns
    /// and each with its low half first, 0 without one; and 1 where it shows by itself that it is there.
    pub(crate) fn numbers(&self) -> [u32; 9] {
        let (history, depth) = match self.history {
            History::KeepLast(depth) => (1, depth.max(1)),
            History::KeepAll => (2, 0),
        };
        let reliability = match self.reliability {
            Reliability::Reliable => 1,
            Reliability::BestEffort => 2,
        };
        let durability = match self.durability {
            Durability::TransientLocal => 1,
            Durability::Volatile => 2,
        };
        let Presence { deadline, lease, manual } = self.presence;
        let halves = |time: Option<Duration>| {
            let time = time.map_or(0, |time| u64::try_from(time.as_nanos()).unwrap_or(0));
            [time as u32, (time >> 32) as u32]
        };
        let ([deadline, later], [lease, longer]) = (halves(deadline), halves(lease));
        let manual = u32::from(manual);
        [history, depth, reliability, durability, deadline, later, lease, longer, manual]
    }
}

/// Package, folder and name of a message type, as `sensor_msgs/msg/Imu` has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Datatype<'text> {
    pub(crate) package: &'text str,
    pub(crate) folder: &'text str,
    pub(crate) name: &'text str,
}

impl<'text> Datatype<'text> {
    /// Reads `package/folder/Name`, or `package/Name` of the folder `msg`.
    pub(crate) fn parse(text: &'text str) -> Result<Datatype<'text>, PlayerError> {
        // They become parts of a library's and a function's name.
        let word = |part: &str| {
            (1..=255).contains(&part.len())
                && part.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
        };
        let parts: Vec<&str> = text.split('/').collect();
        let (package, folder, name) = match parts[..] {
            [package, folder, name] => (package, folder, name),
            [package, name] => (package, "msg", name),
            _ => ("", "", ""),
        };
        if [package, folder, name].into_iter().all(word) {
            Ok(Datatype { package, folder, name })
        } else {
            Err(PlayerError::Datatype(text.to_owned()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_are_named_with_or_without_their_folder() {
        let imu = Datatype { package: "sensor_msgs", folder: "msg", name: "Imu" };
        assert_eq!(Datatype::parse("sensor_msgs/msg/Imu").unwrap(), imu);
        assert_eq!(Datatype::parse("sensor_msgs/Imu").unwrap(), imu);
        let fed = Datatype::parse("nav2_msgs/action/Spin_FeedbackMessage").unwrap();
        assert_eq!((fed.folder, fed.name), ("action", "Spin_FeedbackMessage"));
    }

    #[test]
    fn what_is_no_part_of_a_librarys_name_is_refused() {
        let long = format!("a/{}", "b".repeat(256));
        let wrong = ["", "Imu", "a//Imu", "../x/Imu", "a/b/c/d", "a b/Imu", "a/msg/", &long];
        for text in wrong {
            let error = Datatype::parse(text).unwrap_err().to_string();
            assert!(error.contains("sensor_msgs/msg/Imu"), "{text}: {error}");
        }
    }

    #[test]
    fn numbers_are_those_of_rmw() {
        let qos = |history, reliability, durability| {
            let presence = Presence::NONE;
            Qos { history, reliability, durability, presence }
        };
        let last = qos(History::KeepLast(7), Reliability::Reliable, Durability::Volatile);
        assert_eq!(last.numbers(), [1, 7, 1, 2, 0, 0, 0, 0, 0]);
        let all = qos(History::KeepAll, Reliability::BestEffort, Durability::TransientLocal);
        assert_eq!(all.numbers(), [2, 0, 2, 1, 0, 0, 0, 0, 0]);
        let presence = Presence {
            deadline: Some(Duration::from_nanos(3 << 32 | 5)),
            lease: Some(Duration::from_nanos(7)),
            manual: true,
        };
        assert_eq!(Qos { presence, ..last }.numbers()[4..], [5, 3, 7, 0, 1]);
        assert_eq!(Qos { history: History::KeepLast(0), ..last }.numbers()[1], 1);
    }
}

//! Quality of service, and names of message types.

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

/// Quality of service of a publisher or a subscription; all else is rcl's default.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Qos {
    /// How many messages are kept.
    pub history: History,
    /// Whether lost messages are sent again.
    pub reliability: Reliability,
    /// Whether late subscribers get earlier messages.
    pub durability: Durability,
}

impl Qos {
    /// History, depth, reliability and durability by rmw's numbers.
    pub(crate) fn numbers(&self) -> [u32; 4] {
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
        [history, depth, reliability, durability]
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
        let qos = |history, reliability, durability| Qos { history, reliability, durability };
        let last = qos(History::KeepLast(7), Reliability::Reliable, Durability::Volatile);
        assert_eq!(last.numbers(), [1, 7, 1, 2]);
        let all = qos(History::KeepAll, Reliability::BestEffort, Durability::TransientLocal);
        assert_eq!(all.numbers(), [2, 0, 2, 1]);
        assert_eq!(Qos { history: History::KeepLast(0), ..last }.numbers()[1], 1);
    }
}

//! The profiles that a recording keeps of its publishers (`offered_qos_profiles`), read and written.

use std::time::Duration;

use bagpipe_ros2ledger as ledger;
use bagpipe_ros2player::{Durability, Presence, Reliability};

/// What rmw writes of a time without end.
const ENDLESS: Duration = Duration::new(9_223_372_036, 854_775_807);

/// Over Cyclone DDS a publisher whose lease is a nanosecond reaches nobody.
const LEAST_LEASE: Duration = Duration::from_micros(1);

/// Seconds from which on a recorded time is without end: DDS has 31 bits, as recorders until Galactic wrote.
const LONGEST: u64 = (1 << 31) - 1;

/// What one publisher offered, as far as it matters here.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Profile {
    pub(super) reliability: Option<Reliability>,
    pub(super) durability: Option<Durability>,
    pub(super) depth: u32,
    pub(super) presence: Presence,
}

/// The profiles of `offered_qos_profiles`, in numbers as until Humble or in words. What is not
/// understood is left out.
pub(super) fn profiles(yaml: &str) -> Vec<Profile> {
    let mut found: Vec<Profile> = Vec::new();
    // The last key that had no value of its own, whose parts stand in the lines below it.
    let mut above = String::new();
    for line in yaml.lines() {
        if line.trim_start().starts_with('-') {
            found.push(Profile::default());
        }
        let (Some(profile), Some((key, value))) = (found.last_mut(), line.split_once(':')) else {
            continue;
        };
        let key = key.trim_start().trim_start_matches('-').trim();
        let value = value.trim().trim_matches(['"', '\'']);
        match key {
            "sec" | "nsec" => profile.set_time(&above, key, value),
            _ => profile.set(key, value),
        }
        for part in value.trim_matches(['{', '}']).split(',') {
            if let Some((unit, number)) = part.split_once(':') {
                profile.set_time(key, unit.trim(), number.trim());
            }
        }
        if !matches!(key, "sec" | "nsec") {
            key.clone_into(&mut above);
        }
    }
    found.iter_mut().for_each(Profile::end);
    found
}

impl Profile {
    fn set(&mut self, key: &str, value: &str) {
        match key {
            "reliability" => {
                self.reliability = match value {
                    "1" | "reliable" => Some(Reliability::Reliable),
                    "2" | "best_effort" => Some(Reliability::BestEffort),
                    _ => None,
                }
            }
            "durability" => {
                self.durability = match value {
                    "1" | "transient_local" => Some(Durability::TransientLocal),
                    "2" | "volatile" => Some(Durability::Volatile),
                    _ => None,
                }
            }
            "depth" => self.depth = value.parse().unwrap_or_default(),
            "liveliness" => self.presence.manual = matches!(value, "3" | "manual_by_topic"),
            _ => {}
        }
    }

    /// Takes in seconds or nanoseconds of what stands in this key.
    fn set_time(&mut self, key: &str, unit: &str, value: &str) {
        let time = match key {
            "deadline" => &mut self.presence.deadline,
            "liveliness_lease_duration" => &mut self.presence.lease,
            _ => return,
        };
        let more = match unit {
            "sec" => Duration::from_secs(value.parse().unwrap_or(ENDLESS.as_secs())),
            "nsec" => Duration::from_nanos(value.parse().unwrap_or_default()),
            _ => return,
        };
        *time = Some(time.unwrap_or_default().saturating_add(more));
    }

    /// A time that is none, or without end, is not set.
    fn end(&mut self) {
        for time in [&mut self.presence.deadline, &mut self.presence.lease] {
            *time = time.filter(|time| !time.is_zero() && time.as_secs() < LONGEST);
        }
        self.presence.lease = self.presence.lease.map(|lease| lease.max(LEAST_LEASE));
    }
}

/// What publishers offer, as ROS 2's recorder writes it down.
pub(crate) fn yaml<'a>(publishers: impl Iterator<Item = &'a ledger::Qos>) -> String {
    publishers.map(profile_yaml).collect()
}

fn profile_yaml(qos: &ledger::Qos) -> String {
    let history = match qos.history {
        ledger::History::KeepLast => "keep_last",
        ledger::History::KeepAll => "keep_all",
        ledger::History::Other(_) => "unknown",
    };
    let reliability = match qos.reliability {
        ledger::Reliability::Reliable => "reliable",
        ledger::Reliability::BestEffort => "best_effort",
        ledger::Reliability::Other(_) => "unknown",
    };
    let durability = match qos.durability {
        ledger::Durability::TransientLocal => "transient_local",
        ledger::Durability::Volatile => "volatile",
        ledger::Durability::Other(_) => "unknown",
    };
    let time = |time: Option<Duration>| {
        let time = time.unwrap_or(ENDLESS);
        format!("{{sec: {}, nsec: {}}}", time.as_secs(), time.subsec_nanos())
    };
    let ledger::Presence { deadline, lease, manual } = qos.presence;
    let liveliness = if manual { "manual_by_topic" } else { "automatic" };
    format!(
        "- history: {history}\n  depth: {}\n  reliability: {reliability}\n  durability: \
         {durability}\n  deadline: {}\n  lifespan: {}\n  liveliness: {liveliness}\n  \
         liveliness_lease_duration: {}\n  avoid_ros_namespace_conventions: false\n",
        qos.depth,
        time(deadline),
        time(None),
        time(lease)
    )
}

#[cfg(test)]
mod tests {
    use super::super::tests::{HUMBLE, JAZZY, asked, presence};
    use super::*;

    #[test]
    fn profiles_are_read_in_numbers_and_in_words() {
        let best_effort = Profile {
            reliability: Some(Reliability::BestEffort),
            durability: Some(Durability::Volatile),
            depth: 0,
            presence: Presence::NONE,
        };
        assert_eq!(profiles(HUMBLE), [best_effort]);
        let latched = Profile {
            reliability: Some(Reliability::Reliable),
            durability: Some(Durability::TransientLocal),
            depth: 3,
            presence: Presence { deadline: Some(Duration::new(1, 2)), ..Presence::NONE },
        };
        assert_eq!(profiles(JAZZY), [latched]);
        for broken in ["", "[]", "depth: 3", ":", "- x", "-\n-\n"] {
            assert!(profiles(broken).iter().all(|one| *one == Profile::default()), "{broken:?}");
        }
    }

    #[test]
    fn deadline_and_liveliness_are_read_as_each_release_writes_them() {
        let of = |yaml: &str| profiles(yaml).iter().map(|one| one.presence).collect::<Vec<_>>();
        let block = "- deadline:\n    sec: 0\n    nsec: 100000000\n  lifespan:\n    sec: 5\n    nsec: 0\n  \
                     liveliness: 3\n  liveliness_lease_duration:\n    sec: 2\n    nsec: 0\n";
        let inline = "- deadline: {sec: 0, nsec: 100000000}\n  lifespan: {sec: 5, nsec: 0}\n  liveliness: \
                      manual_by_topic\n  liveliness_lease_duration: {nsec: 0, sec: 2}\n";
        let all = presence(Some(100), Some(2_000), true);
        assert_eq!((of(block), of(inline)), (vec![all], vec![all]));
        assert_eq!(of(&[block, HUMBLE].concat()), [all, Presence::NONE]);
        for endless in [
            "{sec: 9223372036, nsec: 854775807}",
            "{sec: 2147483647, nsec: 4294967295}",
            "{sec: 0, nsec: 0}",
            "{sec: 99999999999999999999999, nsec: 0}",
            "{sec: -1}",
            "{}",
            "[]",
            "x: y: z",
        ] {
            let yaml = format!(
                "- deadline: {endless}\n  liveliness_lease_duration: {endless}\n  liveliness: 1\n"
            );
            assert_eq!(of(&yaml), [Presence::NONE], "{endless}");
        }
        let short = "{sec: 0, nsec: 1}";
        let shortest =
            of(&format!("- deadline: {short}\n  liveliness_lease_duration: {short}\n"))[0];
        assert_eq!(shortest.deadline, Some(Duration::from_nanos(1)));
        assert_eq!(shortest.lease, Some(Duration::from_micros(1)));
        assert_eq!(
            of("- deadline: {sec: 2147483646, nsec: 0}\n")[0].deadline.unwrap().as_secs(),
            2147483646
        );
    }

    #[test]
    fn what_publishers_of_the_stack_offer_is_written_and_read_again() {
        use ledger::{Durability as D, Reliability as R};
        for wanted in
            [presence(Some(100), Some(2_000), true), presence(None, Some(1), false), Presence::NONE]
        {
            let Presence { deadline, lease, manual } = wanted;
            let presence = ledger::Presence { deadline, lease, manual };
            let offered = ledger::Qos { presence, ..asked(R::Reliable, D::Volatile) };
            assert_eq!(profiles(&yaml([offered].iter()))[0].presence, wanted);
        }
    }
}

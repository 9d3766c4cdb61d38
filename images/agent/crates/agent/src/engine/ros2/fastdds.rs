//! How the processes of a case find each other over Fast DDS, where the image leaves that to it: on
//! localhost ROS 2 from Iron on looks for 32 processes of a domain. Another middleware ignores this.

use std::ffi::{OsStr, OsString};
use std::io;
use std::ops::RangeInclusive;
use std::os::unix::ffi::OsStrExt as _;
use std::path::{Path, PathBuf};

use crate::engine::ros2::environment::Variables;

/// Where Fast DDS 2 and 3 look for a profile.
pub const PROFILES: [&str; 2] = ["FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"];
/// Whose processes ask a server who is there, and look at no places.
const SERVER: &str = "ROS_DISCOVERY_SERVER";
const DISTRIBUTION: &str = "ROS_DISTRO";
/// Those of ROS 1 that come behind Humble in the alphabet, as every later one of ROS 2 does (REP 3, REP 2000).
const OF_ROS_1: [&str; 6] = ["indigo", "jade", "kinetic", "lunar", "melodic", "noetic"];
/// The places of a domain at which ROS 2 does not look by itself, to the last that Fast DDS takes: it tries
/// a hundred more than the first (`mutation_tries`).
const PLACES: RangeInclusive<u16> = 32..=100;
/// Where the first place of domain 0 listens for others, and how far it is to the next domain and the next
/// place (DDSI-RTPS 2.3, 9.6.1.1).
const PORT: u16 = 7410;
const TO_NEXT_DOMAIN: u16 = 250;
const TO_NEXT_PLACE: u16 = 2;

/// A profile by which the processes of a case look at all places of its domain.
#[derive(Clone, Debug)]
pub struct Places {
    file: PathBuf,
    participant: String,
}

impl Places {
    /// Writes the profile into a case's folder. `None` where the job or the image (`theirs`) decides, and
    /// where ROS 2 may be older than Iron: processes call for each other by multicast there, and by a list of
    /// places no more.
    ///
    /// # Errors
    /// The file can't be written.
    pub fn write(
        domain: u16,
        folder: &Path,
        theirs: impl Fn(&str) -> Option<OsString>,
    ) -> io::Result<Option<Places>> {
        let decided = [PROFILES[0], PROFILES[1], SERVER].iter().any(|name| theirs(name).is_some());
        if decided || !theirs(DISTRIBUTION).is_some_and(|name| is_iron_or_later(&name)) {
            return Ok(None);
        }
        let file = folder.join("fastdds.xml");
        let participant = looking_from(PORT + TO_NEXT_DOMAIN * domain);
        std::fs::write(&file, profile("", &participant))?;
        Ok(Some(Places { file, participant }))
    }

    /// What each process of the case has.
    pub fn variables(&self) -> [(&'static str, OsString); 2] {
        PROFILES.map(|name| (name, self.file.clone().into()))
    }

    /// What it says of a participant, for a profile that says more.
    pub fn participant(&self) -> &str {
        &self.participant
    }

    /// Takes the profile out of a process's variables; whether it was there.
    pub fn take_from(&self, variables: &mut Variables) -> bool {
        let all = variables.len();
        variables.retain(|(name, value)| {
            value != self.file.as_os_str() || !PROFILES.iter().any(|one| name == one)
        });
        variables.len() < all
    }
}

fn is_iron_or_later(distribution: &OsStr) -> bool {
    let name = distribution.as_bytes();
    name >= b"iron".as_slice() && !OF_ROS_1.iter().any(|one| name == one.as_bytes())
}

fn looking_from(first: u16) -> String {
    let peers = PLACES.map(|place| {
        let port = first + TO_NEXT_PLACE * place;
        format!(
            "<locator><udpv4><address>127.0.0.1</address><port>{port}</port></udpv4></locator>\n"
        )
    });
    let peers: String = peers.collect();
    format!("<builtin><initialPeersList>\n{peers}</initialPeersList></builtin>\n")
}

/// A profile for every participant of a process: descriptors of transports, and what a participant has.
pub fn profile(transports: &str, participant: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <dds xmlns=\"http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles\"><profiles>\n\
         {transports}\
         <participant profile_name=\"bagpipe\" is_default_profile=\"true\"><rtps>\n\
         {participant}\
         </rtps></participant>\n\
         </profiles></dds>\n"
    )
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn written(set: &[(&str, &str)]) -> Option<(Places, String)> {
        let folder = tempfile::tempdir().unwrap();
        let theirs = |name: &str| {
            set.iter().find(|(one, _)| *one == name).map(|(_, value)| OsString::from(value))
        };
        let places = Places::write(101, folder.path(), theirs).unwrap()?;
        let text = std::fs::read_to_string(folder.path().join("fastdds.xml")).unwrap();
        Some((places, text))
    }

    #[test]
    fn from_iron_on_all_places_of_the_domain_are_looked_at() {
        for name in ["iron", "jazzy", "kilted", "lyrical", "rolling"] {
            let (places, text) = written(&[("ROS_DISTRO", name)]).unwrap();
            assert_eq!(text.matches("<locator>").count(), 69);
            // 7410 + 250 * 101 + 2 * 32 and + 2 * 100
            let ports: Vec<u16> = text
                .split("<port>")
                .skip(1)
                .map(|rest| rest.split('<').next().unwrap().parse().unwrap())
                .collect();
            assert_eq!((ports[0], ports[1], ports[68]), (32_724, 32_726, 32_860));
            assert!(ports.is_sorted());
            assert!(text.contains(places.participant()), "{text}");
            assert!(text.contains("is_default_profile=\"true\""), "{text}");
        }
    }

    #[test]
    fn what_may_be_older_keeps_its_calls() {
        assert!(written(&[]).is_none());
        for name in ["", "foxy", "galactic", "humble", "kinetic", "melodic", "noetic"] {
            assert!(written(&[("ROS_DISTRO", name)]).is_none(), "{name}");
        }
    }

    #[test]
    fn who_has_a_profile_or_a_server_keeps_it() {
        for own in [PROFILES[0], PROFILES[1], SERVER] {
            assert!(written(&[("ROS_DISTRO", "jazzy"), (own, "")]).is_none(), "{own}");
        }
    }

    #[test]
    fn a_process_has_it_by_both_names_until_it_is_taken_from_it() {
        let (places, _) = written(&[("ROS_DISTRO", "jazzy")]).unwrap();
        let own = ("HOME".into(), places.file.clone().into());
        let all = places.variables().map(|(name, value)| (OsString::from(name), value));
        let mut variables = [vec![own.clone()], all.to_vec()].concat();
        assert_eq!(variables.len(), 3);
        assert!(places.take_from(&mut variables));
        assert_eq!(variables, [own]);
        assert!(!places.take_from(&mut variables));
        let mut theirs = vec![(PROFILES[0].into(), "theirs.xml".into())];
        assert!(!places.take_from(&mut theirs));
        assert_eq!(theirs.len(), 1);
    }
}

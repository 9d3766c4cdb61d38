//! A case's domain, in which no other case of the machine is.

use std::ffi::OsString;
use std::io::ErrorKind;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};

use crate::case::failure::Failure;

/// Domains whose ports are below those that the system gives away (REP 2, Linux): 0 to 101.
pub const DOMAINS: u16 = 101;

/// Cyclone DDS has places for so many processes of a domain; on localhost ROS 2 from Iron on asks for
/// 32, and what was before for 10. These are all whose ports lie in a domain's range.
pub const PARTICIPANTS: &str = "<CycloneDDS><Domain><Discovery><MaxAutoParticipantIndex>119\
     </MaxAutoParticipantIndex></Discovery></Domain></CycloneDDS>";

/// A domain that is a case's own as long as this is kept.
#[derive(Debug)]
pub struct Domain {
    /// 1 to 101.
    pub number: u16,
    /// A name that the kernel gives to one process of this network namespace, and takes back when
    /// that ends; nothing where such names are not to be had.
    _held: Option<UnixListener>,
}

impl Domain {
    /// Takes a slot's own domain, or where another run's slot has it, the next one that is free.
    pub fn hold(port: u16) -> Result<Domain, Failure> {
        Self::hold_by(port, "bagpipe-domain")
    }

    fn hold_by(port: u16, name: &str) -> Result<Domain, Failure> {
        let turn = |one| 1 + (port % DOMAINS + one) % DOMAINS;
        for number in (0..DOMAINS).map(turn) {
            let address = SocketAddr::from_abstract_name(format!("{name}-{number}"));
            match address.and_then(|address| UnixListener::bind_addr(&address)) {
                Ok(held) => return Ok(Domain { number, _held: Some(held) }),
                Err(error) if error.kind() == ErrorKind::AddrInUse => {}
                // The slot's own, as no other slot of this run has it.
                Err(_) => return Ok(Domain { number, _held: None }),
            }
        }
        let why = format!(
            "each of the {DOMAINS} domains of ROS 2 is a running case's: end one of the runs on \
             this machine"
        );
        Err(Failure::new("Ros2Failed", why))
    }
}

/// Settings that let more processes join, unless there are some: Cyclone DDS reads them behind ROS 2's
/// own.
pub fn cyclone(theirs: Option<OsString>) -> OsString {
    theirs.unwrap_or_else(|| PARTICIPANTS.into())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::time::{Duration, Instant};

    use super::*;

    // Promise: domain-of-its-own
    #[test]
    fn no_two_cases_have_one_domain_and_what_ended_gives_it_back() {
        // Not by the name of real cases, which run meanwhile.
        let hold = || Domain::hold_by(21_311, &format!("bagpipe-test-{}", std::process::id()));
        let mut all: Vec<Domain> = (0..101).map(|_| hold().unwrap()).collect();
        let numbers: BTreeSet<u16> = all.iter().map(|one| one.number).collect();
        assert_eq!(numbers, (1..=101).collect());
        assert!(format!("{:?}", hold().unwrap_err()).contains("each of the 101 domains"));
        let given_back = all.remove(40).number;
        // A process that another test has forked just now has the name, too, until it executes its program.
        let deadline = Instant::now() + Duration::from_secs(60);
        let again = loop {
            match hold() {
                Ok(again) => break again,
                Err(_) => assert!(Instant::now() < deadline, "it was not given back"),
            }
            std::thread::yield_now();
        };
        assert_eq!(again.number, given_back);
    }

    #[test]
    fn a_users_own_settings_stay() {
        assert_eq!(cyclone(Some("file:///mine.xml".into())), "file:///mine.xml");
        assert!(cyclone(None).to_string_lossy().contains("MaxAutoParticipantIndex>119<"));
    }
}

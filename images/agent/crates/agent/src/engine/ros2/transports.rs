//! How the player's middleware sends large messages, where the image leaves that to it. The nodes of
//! the stack keep what their image has; a middleware ignores what is another's.
//!
//! Fast DDS sends by 512 KiB of shared memory, in pieces of 64 KiB: of a larger message the last ones
//! find no room, and the reader asks for them again, after 5 ms each time. The memory is the
//! writer's. Cyclone DDS sends datagrams of 14 KiB, where loopback takes 64. What it is worth is in
//! docs/performance.md.

use std::ffi::OsStr;
use std::path::Path;

use crate::engine::ros2::domain::PARTICIPANTS;
use crate::engine::ros2::environment::Variables;
use crate::engine::ros2::fastdds::{PROFILES, Places, profile};

/// Bytes of the player's shared memory: what is on its way at a time has at most one MiB, unless a
/// single message is larger. Memory is taken as it is used.
const SEGMENT: usize = 16 << 20;
/// What beside a profile decides on Fast DDS's transports.
const BUILTIN: &str = "FASTDDS_BUILTIN_TRANSPORTS";
/// Where Cyclone DDS looks for its configuration.
const CYCLONE: &str = "CYCLONEDDS_URI";
const DATAGRAMS: &str = "<CycloneDDS><Domain><General>\
                         <MaxMessageSize>65500B</MaxMessageSize>\
                         </General></Domain></CycloneDDS>";

/// Adds to the player's variables what its middleware needs, unless the image has its own. A profile that
/// the case's processes have from us is none of the image's: its `places` go into the player's.
///
/// # Errors
/// A file can't be written into the folder.
pub fn with_transports(
    mut variables: Variables,
    folder: &Path,
    places: Option<&Places>,
) -> std::io::Result<Variables> {
    if !is_set(&variables, &[BUILTIN]) {
        let places = places.filter(|places| places.take_from(&mut variables));
        if !is_set(&variables, &PROFILES) {
            let file = folder.join("player.fastdds.xml");
            std::fs::write(&file, player_profile(places.map_or("", Places::participant)))?;
            variables.extend(PROFILES.map(|name| (name.into(), file.clone().into())));
        }
    }
    match variables.iter_mut().find(|(name, _)| name == CYCLONE) {
        // Every process of a case has these settings of ours.
        Some((_, settings)) if settings == PARTICIPANTS => {
            *settings = format!("{PARTICIPANTS},{DATAGRAMS}").into();
        }
        Some(_) => {}
        None => variables.push((CYCLONE.into(), DATAGRAMS.into())),
    }
    Ok(variables)
}

fn is_set(variables: &Variables, names: &[&str]) -> bool {
    variables.iter().any(|(name, _)| names.iter().any(|one| name == OsStr::new(one)))
}

fn player_profile(places: &str) -> String {
    let transports = format!(
        "<transport_descriptors><transport_descriptor>\n\
         <transport_id>shared_memory</transport_id><type>SHM</type>\n\
         <segment_size>{SEGMENT}</segment_size>\n\
         </transport_descriptor></transport_descriptors>\n"
    );
    let used = "<userTransports><transport_id>shared_memory</transport_id></userTransports>\n";
    profile(&transports, &format!("{used}{places}"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::ffi::OsString;

    use super::*;

    fn set(names: &[&str]) -> Variables {
        names.iter().map(|name| ((*name).into(), "x".into())).collect()
    }

    #[test]
    fn an_image_that_decides_for_itself_keeps_what_it_has() {
        let folder = Path::new("/none/such");
        for name in [PROFILES[0], PROFILES[1], BUILTIN] {
            let own = set(&["HOME", name, CYCLONE]);
            assert_eq!(with_transports(own.clone(), folder, None).unwrap(), own);
        }
        let datagrams = vec![(CYCLONE.into(), DATAGRAMS.into())];
        let both = [set(&[BUILTIN]), datagrams].concat();
        assert_eq!(with_transports(set(&[BUILTIN]), folder, None).unwrap(), both);
        let other = set(&["FASTDDS_ENVIRONMENT_FILE", CYCLONE]);
        assert!(with_transports(other, folder, None).is_err());
    }

    #[test]
    fn what_all_processes_of_a_case_have_is_no_decision_of_the_images() {
        let variables = [set(&[BUILTIN]), vec![(CYCLONE.into(), PARTICIPANTS.into())]].concat();
        let made = with_transports(variables, Path::new("/none/such"), None).unwrap();
        assert_eq!(made[1].1, format!("{PARTICIPANTS},{DATAGRAMS}").as_str());
    }

    #[test]
    fn the_places_of_a_case_go_into_the_players_profile_and_are_no_decision_of_the_images() {
        let folder = tempfile::tempdir().unwrap();
        let theirs = |name: &str| (name == "ROS_DISTRO").then(|| "jazzy".into());
        let places = Places::write(7, folder.path(), theirs).unwrap().unwrap();
        let ours: Variables =
            places.variables().map(|(name, value)| (OsString::from(name), value)).to_vec();
        let made = |variables: &Variables| {
            with_transports(variables.clone(), folder.path(), Some(&places)).unwrap()
        };
        let file = folder.path().join("player.fastdds.xml");
        let of_the_player: Variables =
            PROFILES.iter().map(|name| ((*name).into(), file.clone().into())).collect();
        let cyclone = set(&[CYCLONE]);
        assert_eq!(
            made(&[ours.clone(), cyclone.clone()].concat()),
            [cyclone, of_the_player].concat()
        );
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(text.contains("<segment_size>16777216</segment_size>"), "{text}");
        assert!(text.contains(places.participant()), "{text}");
        std::fs::remove_file(&file).unwrap();
        let decided = [ours.clone(), set(&[BUILTIN, CYCLONE])].concat();
        assert_eq!(made(&decided), decided);
        // One of the two names is the command's own.
        let mixed = [ours[..1].to_vec(), set(&[PROFILES[1], CYCLONE])].concat();
        assert_eq!(made(&mixed), set(&[PROFILES[1], CYCLONE]));
        assert!(!file.exists());
    }

    #[test]
    fn both_generations_of_fast_dds_find_the_file() {
        let folder = std::env::temp_dir().join(format!("transports-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let variables = with_transports(set(&[CYCLONE]), &folder, None).unwrap();
        let file = folder.join("player.fastdds.xml");
        let added: Variables =
            PROFILES.iter().map(|name| ((*name).into(), file.clone().into())).collect();
        assert_eq!(variables, [set(&[CYCLONE]), added].concat());
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(text.contains("<segment_size>16777216</segment_size>"), "{text}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}

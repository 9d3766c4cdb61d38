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

/// Bytes of the player's shared memory: what is on its way at a time has at most one MiB, unless a
/// single message is larger. Memory is taken as it is used.
const SEGMENT: usize = 16 << 20;
/// Where Fast DDS 2 and 3 look for a profile.
const PROFILES: [&str; 2] = ["FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"];
/// What else decides on its transports.
const BUILTIN: &str = "FASTDDS_BUILTIN_TRANSPORTS";
/// Where Cyclone DDS looks for its configuration.
const CYCLONE: &str = "CYCLONEDDS_URI";
const DATAGRAMS: &str = "<CycloneDDS><Domain><General>\
                         <MaxMessageSize>65500B</MaxMessageSize>\
                         </General></Domain></CycloneDDS>";

/// Adds to the player's variables what its middleware needs, unless the image has its own.
///
/// # Errors
/// A file can't be written into the folder.
pub fn with_transports(mut variables: Variables, folder: &Path) -> std::io::Result<Variables> {
    let decided = |names: &[&str]| {
        variables.iter().any(|(name, _)| names.iter().any(|one| name == OsStr::new(one)))
    };
    if !decided(&[PROFILES[0], PROFILES[1], BUILTIN]) {
        let file = folder.join("player.fastdds.xml");
        std::fs::write(&file, profile())?;
        variables.extend(PROFILES.map(|name| (name.into(), file.clone().into())));
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

fn profile() -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <dds xmlns=\"http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles\"><profiles>\n\
         <transport_descriptors><transport_descriptor>\n\
         <transport_id>shared_memory</transport_id><type>SHM</type>\n\
         <segment_size>{SEGMENT}</segment_size>\n\
         </transport_descriptor></transport_descriptors>\n\
         <participant profile_name=\"bagpipe_player\" is_default_profile=\"true\"><rtps>\n\
         <userTransports><transport_id>shared_memory</transport_id></userTransports>\n\
         </rtps></participant>\n\
         </profiles></dds>\n"
    )
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn set(names: &[&str]) -> Variables {
        names.iter().map(|name| ((*name).into(), "x".into())).collect()
    }

    #[test]
    fn an_image_that_decides_for_itself_keeps_what_it_has() {
        let folder = Path::new("/none/such");
        for name in [PROFILES[0], PROFILES[1], BUILTIN] {
            let own = set(&["HOME", name, CYCLONE]);
            assert_eq!(with_transports(own.clone(), folder).unwrap(), own);
        }
        let datagrams = vec![(CYCLONE.into(), DATAGRAMS.into())];
        let both = [set(&[BUILTIN]), datagrams].concat();
        assert_eq!(with_transports(set(&[BUILTIN]), folder).unwrap(), both);
        assert!(with_transports(set(&["FASTDDS_ENVIRONMENT_FILE", CYCLONE]), folder).is_err());
    }

    #[test]
    fn what_all_processes_of_a_case_have_is_no_decision_of_the_images() {
        let variables = [set(&[BUILTIN]), vec![(CYCLONE.into(), PARTICIPANTS.into())]].concat();
        let made = with_transports(variables, Path::new("/none/such")).unwrap();
        assert_eq!(made[1].1, format!("{PARTICIPANTS},{DATAGRAMS}").as_str());
    }

    #[test]
    fn both_generations_of_fast_dds_find_the_file() {
        let folder = std::env::temp_dir().join(format!("transports-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let variables = with_transports(set(&[CYCLONE]), &folder).unwrap();
        let file = folder.join("player.fastdds.xml");
        let added: Variables =
            PROFILES.iter().map(|name| ((*name).into(), file.clone().into())).collect();
        assert_eq!(variables, [set(&[CYCLONE]), added].concat());
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(text.contains("<segment_size>16777216</segment_size>"), "{text}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}

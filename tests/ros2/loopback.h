/* Where the stand-in's programs look for each other without CYCLONEDDS_URI: unicast on loopback, for
 * more processes than Cyclone looks for. */
#pragma once
#define LOOPBACK_SETTINGS                                                                          \
  "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name=\"lo\" multicast=\"false\"/>"   \
  "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery>"                       \
  "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>40</MaxAutoParticipantIndex>" \
  "<Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>"

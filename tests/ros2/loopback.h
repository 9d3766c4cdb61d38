/* Where the stand-in's programs look for each other: on loopback, and as far as rmw_cyclonedds does
 * with ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST. CYCLONEDDS_URI comes behind it, and may name
 * interfaces of its own. */
#pragma once
#include <dds/dds.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static inline dds_entity_t loopback_domain(dds_domainid_t number) {
  static const char loopback[] =
      "<Interfaces><NetworkInterface name=\"lo\" multicast=\"false\"/></Interfaces>";
  static const char localhost[] =
      "<CycloneDDS><Domain><General>%s<AllowMulticast>false</AllowMulticast></General><Discovery>"
      "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
      "<Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>,%s";
  const char *own = getenv("CYCLONEDDS_URI");
  if (own == NULL) own = "";
  char both[4096];
  const char *interfaces = strstr(own, "<Interfaces>") == NULL ? loopback : "";
  int length = snprintf(both, sizeof both, localhost, interfaces, own);
  if (length < 0 || (size_t)length >= sizeof both) return DDS_RETCODE_BAD_PARAMETER;
  return dds_create_domain(number, both);
}

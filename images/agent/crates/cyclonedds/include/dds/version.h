/* The version of the sources (cyclonedds-src 1.0.2). */
#pragma once
#define DDS_VERSION "11.0.0"
#define DDS_VERSION_MAJOR 11
#define DDS_VERSION_MINOR 0
#define DDS_VERSION_PATCH 0
#define DDS_VERSION_TWEAK 0
#define DDS_PROJECT_NAME "CycloneDDS"
#define DDS_GIT_HASH ""
#define DDS_HOST_NAME "Linux"
#define DDS_TARGET_NAME "Linux"

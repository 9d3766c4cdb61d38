/* Which parts of Cyclone DDS are built: of those that can be left out, deadlines alone, which publishers
 * may have been recorded with. */
#pragma once
#define DDS_IS_STATIC_LIBRARY 1
#define DDS_HAS_DEADLINE_MISSED 1

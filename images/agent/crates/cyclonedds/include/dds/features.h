/* Which parts of Cyclone DDS are built: none of those that can be left out. */
#pragma once
#define DDS_IS_STATIC_LIBRARY 1

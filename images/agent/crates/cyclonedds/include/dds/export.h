/* Nothing is exported from an archive. */
#pragma once
#define DDS_EXPORT
#define DDS_NO_EXPORT
#define DDS_DEPRECATED
#define DDS_DEPRECATED_EXPORT
#define DDS_INLINE_EXPORT
#define DDS_EXPORT_INTERNAL_FUNCTION

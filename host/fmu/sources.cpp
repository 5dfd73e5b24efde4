// The hash of the sources of this library, which `forceaxis fmu` finds in the file by the text
// before it (forceaxis/fmu/unit.py).
extern "C" {
extern const char forceaxis_sources[];
const char forceaxis_sources[] = "forceaxis sources " FORCEAXIS_SOURCES_HASH;
}

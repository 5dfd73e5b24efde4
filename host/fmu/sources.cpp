// The hash of the sources of this library. `forceaxis fmu` searches the file of the library for the
// text before the hash (forceaxis/fmu/unit.py).
extern "C" {
extern const char forceaxis_sources[];
const char forceaxis_sources[] = "forceaxis sources " FORCEAXIS_SOURCES_HASH;
}

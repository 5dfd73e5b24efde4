// Gives a fuzzer its kept inputs, without libFuzzer: a line of hexadecimal digits each.
//
// usage: NAME_replay corpus/NAME.hex
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size);

int main(int argc, char **argv) {
  if (argc != 2) return 2;
  std::ifstream file(argv[1]);
  std::string line;
  std::size_t count = 0;
  while (std::getline(file, line)) {
    std::vector<std::uint8_t> bytes;
    for (std::size_t i = 0; i + 2 <= line.size(); i += 2) {
      bytes.push_back(static_cast<std::uint8_t>(std::stoi(line.substr(i, 2), nullptr, 16)));
    }
    // Last on the screen if it ends the program.
    std::printf("%s:%zu\n", argv[1], ++count);
    std::fflush(stdout);
    LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
  }
  return count == 0 ? 1 : 0;
}

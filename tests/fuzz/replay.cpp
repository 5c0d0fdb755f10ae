// SPDX-License-Identifier: Apache-2.0
//
// Shows a decoder the inputs of a folder, and what becomes of its own seeds cut and changed: the part of
// fuzzing that needs no libFuzzer. `--write-seeds FOLDER` writes the seeds for it.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <random>
#include <string>

#include "tests/fuzz/fuzz_target.h"

namespace {

namespace fs = std::filesystem;

cairn::fuzz::Input read_bytes(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

int write_seeds(const fs::path& folder) {
  fs::create_directories(folder);
  size_t number = 0;
  for (const auto& seed : cairn::fuzz::seeds()) {
    std::ofstream out(folder / ("seed-" + std::to_string(number++)), std::ios::binary);
    out.write(reinterpret_cast<const char*>(seed.data()), static_cast<std::streamsize>(seed.size()));
  }
  std::printf("%zu seeds in %s\n", number, folder.c_str());
  return number > 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

/// Every seed as it is, cut at some places, and with some bytes changed.
size_t show_damaged_seeds(unsigned random_seed) {
  std::mt19937 random(random_seed);
  size_t shown = 0;
  for (const auto& seed : cairn::fuzz::seeds()) {
    cairn::fuzz::decode(seed);
    for (int i = 0; i < 20; ++i) {
      cairn::fuzz::Input bytes = seed;
      if (i % 4 == 0 && !bytes.empty()) bytes.resize(random() % bytes.size());
      for (size_t changes = random() % 8; changes > 0 && !bytes.empty(); --changes)
        bytes[random() % bytes.size()] = static_cast<uint8_t>(random());
      cairn::fuzz::decode(bytes);
      ++shown;
    }
  }
  return shown;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  if (arguments.size() == 2 && arguments[0] == "--write-seeds") return write_seeds(arguments[1]);
  if (arguments.size() != 1) {
    std::fprintf(stderr, "usage: %s CORPUS-FOLDER | --write-seeds FOLDER\n", argv[0]);
    return 2;
  }
  std::vector<fs::path> inputs;
  for (const auto& entry : fs::directory_iterator(arguments[0])) inputs.push_back(entry.path());
  std::sort(inputs.begin(), inputs.end());
  for (const fs::path& input : inputs) {
    std::fprintf(stderr, "%s\n", input.c_str());  // the last line names the one that ends the process
    cairn::fuzz::decode(read_bytes(input));
  }
  const unsigned random_seed = std::random_device()();
  std::fprintf(stderr, "seed %u\n", random_seed);
  const size_t damaged = show_damaged_seeds(random_seed);
  std::printf("%zu inputs and %zu damaged seeds were decoded or refused\n", inputs.size(), damaged);
  return inputs.empty() ? EXIT_FAILURE : EXIT_SUCCESS;
}

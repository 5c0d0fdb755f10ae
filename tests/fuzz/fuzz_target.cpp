// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/fuzz_target.h"

#include <sys/mman.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>

namespace cairn::fuzz {

void demand(bool holds, const char* law) {
  if (holds) return;
  std::fprintf(stderr, "a law does not hold: %s\n", law);
  std::abort();
}

MemoryFile::MemoryFile(std::span<const uint8_t> bytes) : descriptor_(::memfd_create("input", 0)) {
  demand(descriptor_ >= 0, "memfd_create() gives a file");
  demand(::write(descriptor_, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size()),
         "a file in memory takes what is written");
}

MemoryFile::~MemoryFile() {
  ::close(descriptor_);
}

std::filesystem::path MemoryFile::path() const {
  return "/proc/self/fd/" + std::to_string(descriptor_);
}

}  // namespace cairn::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);  // libFuzzer declares it nowhere
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  cairn::fuzz::decode({data, size});
  return 0;
}

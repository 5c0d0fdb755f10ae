// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/fuzz_target.h"

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>

namespace cairn::fuzz {
namespace {

namespace fs = std::filesystem;

fs::path folder_in_memory() {
  std::error_code ignored;
  const fs::path memory("/dev/shm");
  return fs::is_directory(memory, ignored) ? memory : fs::temp_directory_path();
}

}  // namespace

void demand(bool holds, const char* law) {
  if (holds) return;
  std::fprintf(stderr, "a law does not hold: %s\n", law);
  std::abort();
}

void demand(bool holds, const std::string& law) {
  demand(holds, law.c_str());
}

MemoryFile::MemoryFile(Bytes bytes) : descriptor_(::memfd_create("input", 0)) {
  demand(descriptor_ >= 0, "memfd_create() gives a file");
  demand(::write(descriptor_, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size()),
         "a file in memory takes what is written");
}

MemoryFile::~MemoryFile() {
  ::close(descriptor_);
}

fs::path MemoryFile::path() const {
  return "/proc/self/fd/" + std::to_string(descriptor_);
}

OwnFolder::OwnFolder() : path_(folder_in_memory() / ("cairn-fuzz." + std::to_string(::getpid()))) {
  std::error_code problem;
  fs::remove_all(path_, problem);
  demand(fs::create_directories(path_, problem), "a folder for files can be made");
}

OwnFolder::~OwnFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

void OwnFolder::write(const fs::path& name, Bytes bytes) const {
  const fs::path file = path_ / name;
  std::error_code ignored;
  fs::create_directories(file.parent_path(), ignored);
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  out.close();
  demand(!out.fail(), "a file can be written");
}

Input input_of(size_t decoder, Bytes bytes) {
  Input input(1 + bytes.size(), static_cast<uint8_t>(decoder));
  std::copy(bytes.begin(), bytes.end(), input.begin() + 1);
  return input;
}

}  // namespace cairn::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);  // libFuzzer declares it nowhere
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  cairn::fuzz::decode({data, size});
  return 0;
}

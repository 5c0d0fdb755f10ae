// SPDX-License-Identifier: Apache-2.0
#include "server/store/damaged_folder.h"

#include <algorithm>
#include <chrono>
#include <ctime>
#include <fstream>
#include <string_view>
#include <utility>

#include "server/store/database_files.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

constexpr size_t kHexDigits = 32;  ///< of an id
constexpr int64_t kNanosecondsPerSecond = 1'000'000'000;
constexpr std::string_view kNameLine = "map ";
constexpr const char* kReasonsSuffix = ".txt";

void read_reasons(DamagedFile* file) {
  std::ifstream in(reasons_path_of(file->path));
  for (std::string line; std::getline(in, line);) file->reasons.push_back(std::move(line));
  if (file->reasons.empty() || !file->reasons.front().starts_with(kNameLine)) return;
  file->name = file->reasons.front().substr(kNameLine.size());
  file->reasons.erase(file->reasons.begin());
}

/// Whether a file in the folder `damaged` was set aside by itself; all others there are companions of such
/// files, and their reasons.
bool is_set_aside(const fs::path& path) {
  const std::string extension = path.extension();
  if (extension == kMapLogSuffix) return !is_there(fs::path(path).replace_extension(kMapSuffix));
  return extension == kMapSuffix || extension == kCatalogueSuffix;
}

}  // namespace

std::string utc_stamp() {
  const std::time_t now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  std::tm parts{};
  gmtime_r(&now, &parts);
  char text[32];
  std::strftime(text, sizeof(text), "%Y%m%dT%H%M%SZ", &parts);
  return text;
}

Timestamp changed_at(const struct stat& file) {
  return {file.st_mtim.tv_sec * kNanosecondsPerSecond + file.st_mtim.tv_nsec};
}

fs::path reasons_path_of(const fs::path& file) {
  return file.string() + kReasonsSuffix;
}

void write_reasons(const fs::path& beside, const std::string& name, const std::vector<std::string>& reasons) {
  std::ofstream out(reasons_path_of(beside));
  if (!name.empty()) out << kNameLine << name << '\n';
  for (const std::string& reason : reasons) out << reason << '\n';
}

std::vector<DamagedFile> damaged_files_in(const fs::path& folder) {
  std::vector<DamagedFile> files;
  std::error_code problem;
  for (fs::directory_iterator it(folder, problem), end; !problem && it != end; it.increment(problem)) {
    DamagedFile file{.path = it->path(), .map = {}, .name = {}, .set_aside = {}, .reasons = {}};
    struct stat status {};
    if (!is_set_aside(file.path) || ::stat(file.path.c_str(), &status) != 0) continue;
    file.bytes = static_cast<uint64_t>(status.st_size);
    // The reasons are as old as the move; the file itself keeps its time.
    if (::stat(reasons_path_of(file.path).c_str(), &status) == 0) file.set_aside = changed_at(status);
    if (const auto id = from_hex(file.path.stem().string().substr(0, kHexDigits))) file.map = MapId{*id};
    read_reasons(&file);
    files.push_back(std::move(file));
  }
  std::sort(files.begin(), files.end(),
            [](const DamagedFile& a, const DamagedFile& b) { return a.path < b.path; });
  return files;
}

}  // namespace cairn

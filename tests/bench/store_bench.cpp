// SPDX-License-Identifier: Apache-2.0
// cairn-store-bench: how long a server's maps take to come back, and what an accepted keyframe costs.
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <future>
#include <string>
#include <vector>

#include "common/base/log.h"
#include "server/service/map_persistence.h"
#include "server/service/store_threads.h"
#include "server/service/worker_pool.h"
#include "server/store/row_codec.h"

namespace cairn {
namespace {

using Clock = std::chrono::steady_clock;

double ms_since(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

double cpu_ms() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto ms = [](const timeval& t) {
    return 1e3 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_usec);
  };
  return ms(usage.ru_utime) + ms(usage.ru_stime);
}

MapId copy_id(int number) {
  MapId id{{0xbe}};
  id.bytes[15] = static_cast<uint8_t>(number);
  id.bytes[14] = static_cast<uint8_t>(number >> 8);
  return id;
}

/// Copies of one map in a folder, each under an id of its own.
Status make_copies(const StoredMap& map, const std::filesystem::path& folder, int copies) {
  auto store = Store::open(folder, null_logger());
  if (!store) return tl::unexpected(store.error());
  for (int i = 0; i < copies; ++i) {
    MapHeader header = map.header;
    header.id = copy_id(i);
    if (Status made = (*store)->create(header, {map.record, map.decisions, map.labels, {}}); !made)
      return made;
  }
  return {};
}

Status time_restore(const std::filesystem::path& folder, int threads) {
  auto persistence = MapPersistence::start(folder, store_threads(null_logger()), null_logger());
  if (!persistence) return tl::unexpected(persistence.error());
  const auto begin = Clock::now();
  const double cpu = cpu_ms();
  const std::vector<RestoredMap> maps = (*persistence)->opening().restore({}, on_threads(threads));
  MapStatistics sum;
  for (const RestoredMap& map : maps) {
    const MapStatistics statistics = map.maker->statistics();
    sum.keyframes += statistics.keyframes;
    sum.points += statistics.points;
    sum.bytes += statistics.bytes;
  }
  std::printf("restore, %d thread(s): %zu maps, %zu keyframes, %zu points: %.0f ms, %.0f ms CPU; %.0f MB\n",
              threads, maps.size(), sum.keyframes, sum.points, ms_since(begin), cpu_ms() - cpu,
              static_cast<double>(sum.bytes) * 1e-6);
  return {};
}

/// Times what an idle map needs before its next work: its images from the file, decoded and prepared by one
/// thread.
Status time_paging_in(const std::filesystem::path& folder) {
  auto persistence = MapPersistence::start(folder, store_threads(null_logger()), null_logger());
  if (!persistence) return tl::unexpected(persistence.error());
  std::vector<double> reads;
  std::vector<double> paged_in;
  size_t keyframes = 0;
  size_t evicted = 0;
  size_t resident = 0;
  for (const RestoredMap& map :
       (*persistence)->opening().restore({}, on_threads(2), RestoredImages::kEvicted)) {
    const auto begin = Clock::now();
    const std::vector<KeyframeId> lacking = map.maker->lacking_images();
    if (lacking.empty()) continue;  // it has work to do
    keyframes = lacking.size();
    evicted = map.maker->statistics().bytes;
    double reading = 0;
    while (map.maker->lacks_any_images()) {
      const auto turn = Clock::now();
      auto read = std::make_shared<std::promise<Result<std::vector<ImageRow>>>>();
      (*persistence)->read_images(map.header.id, map.maker->lacking_images(), [read](auto rows) {
        read->set_value(rows);
      });
      const auto rows = read->get_future().get();
      if (!rows) return tl::unexpected(rows.error());
      reading += ms_since(turn);
      for (const ImageRow& row : *rows)
        (void)map.maker->page_in_image(row.keyframe, decode_image_row(row.data)->view());
    }
    reads.push_back(reading);
    paged_in.push_back(ms_since(begin));
    resident = map.maker->statistics().bytes;
  }
  if (paged_in.empty()) return fail(ErrorCode::kUsage, "the map has work to do: it is not idle");
  std::sort(reads.begin(), reads.end());
  std::sort(paged_in.begin(), paged_in.end());
  std::printf(
      "a map of %zu keyframes, idle, %.1f MB: read p50 %.1f ms, paged in p50 %.1f, most %.1f ms, %.1f MB\n",
      keyframes, static_cast<double>(evicted) * 1e-6, reads[reads.size() / 2], paged_in[paged_in.size() / 2],
      paged_in.back(), static_cast<double>(resident) * 1e-6);
  return {};
}

/// Times commits, from handing in a keyframe to its answer, one after another and with all maps at once.
Status time_commits(const StoredMap& map, const std::filesystem::path& folder, int copies, int rounds) {
  auto persistence = MapPersistence::start(folder, store_threads(null_logger()), null_logger());
  if (!persistence) return tl::unexpected(persistence.error());
  MapUpdate keyframe;  // as an accepted one: image, measurements, new points, moved points
  keyframe.record.keyframe_count = map.record.keyframe_count;
  keyframe.record.point_count = map.record.point_count;
  keyframe.record.keyframes = {map.record.keyframes.back()};
  keyframe.record.images = {map.record.images.back()};
  keyframe.record.measurements = map.record.measurements;
  keyframe.record.positions = map.record.positions;
  for (const int at_once : {1, copies}) {
    std::vector<double> waits;
    for (int round = 0; round < rounds; ++round) {
      std::vector<std::future<double>> answers;
      for (int i = 0; i < at_once; ++i) {
        auto answered = std::make_shared<std::promise<double>>();
        answers.push_back(answered->get_future());
        (*persistence)->write(copy_id(i), keyframe, [answered, begin = Clock::now()](const Status& kept) {
          answered->set_value(kept ? ms_since(begin) : -1);
        });
      }
      for (auto& answer : answers) waits.push_back(answer.get());
    }
    std::sort(waits.begin(), waits.end());
    std::printf("keyframe to its answer, %d map(s) at once: p50 %.1f, p95 %.1f, most %.1f ms\n", at_once,
                waits[waits.size() / 2], waits[waits.size() * 95 / 100], waits.back());
  }
  return {};
}

Status run(const std::string& archive, const std::filesystem::path& folder, int copies, int rounds) {
  std::filesystem::copy_file(archive, folder / "archive");
  const auto map = read_archive(folder / "archive");
  if (!map) return tl::unexpected(map.error());
  const auto begin = Clock::now();
  if (Status made = make_copies(*map, folder / "store", copies); !made) return made;
  size_t bytes = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder / "store" / "maps"))
    bytes += entry.file_size();
  std::printf("%d maps written in %.0f ms; %.1f MB, %.2f MB a keyframe\n", copies, ms_since(begin),
              static_cast<double>(bytes) * 1e-6,
              static_cast<double>(bytes) * 1e-6 / static_cast<double>(map->record.images.size()) / copies);
  for (const int threads : {1, 2}) {
    if (Status timed = time_restore(folder / "store", threads); !timed) return timed;
  }
  if (Status timed = time_paging_in(folder / "store"); !timed) return timed;
  return time_commits(*map, folder / "store", copies, rounds);
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  CLI::App app("Times the store with copies of one map.", "cairn-store-bench");
  std::string archive;
  std::string folder;
  int copies = 12;
  int rounds = 20;
  app.add_option("ARCHIVE", archive, "a .cairnmap file, e.g. of a store's folder maps")->required();
  app.add_option("FOLDER", folder, "to work in, on the disk to be timed; must not exist")->required();
  app.add_option("--copies", copies, "maps")->capture_default_str();
  app.add_option("--rounds", rounds, "of commits")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  std::filesystem::create_directories(folder);
  const cairn::Status done = cairn::run(archive, folder, copies, rounds);
  std::filesystem::remove_all(folder);
  if (done) return 0;
  cairn::say_error("cairn-store-bench", done.error().message);
  return cairn::exit_code(done.error().code);
}

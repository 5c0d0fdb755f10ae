// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/server_option_rows.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <limits>

#include "common/map/limits.h"
#include "common/wire/participant.h"
#include "common/wire/security.h"

namespace cairn {
namespace {

constexpr uint64_t kMostMegabytes = uint64_t{1} << 40;
constexpr const char* kAnyWord = "needs a value";
constexpr const char* kFromOne = "expected a number from 1 on";
constexpr const char* kFromZero = "expected a number from 0 on";
constexpr const char* kSecondsFromZero = "expected a number of seconds from 0 on";

using Text = const std::string&;

/// Reads a number from `least` to `most`. False, and `value` as it was: the text is none.
template <typename Number>
bool read_number(Text text, Number least, Number most, Number* value) {
  Number number{};
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), number);
  const bool is_number = problem == std::errc() && end == text.data() + text.size();
  if (!is_number || !(number >= least && number <= most)) return false;  // NaN is neither
  *value = number;
  return true;
}

bool read_count(Text text, size_t* value, size_t most = std::numeric_limits<size_t>::max()) {
  return read_number<size_t>(text, 1, most, value);
}

bool read_rate(Text text, double* value) {
  return read_number<double>(text, 0, std::numeric_limits<double>::max(), value);
}

bool read_seconds(Text text, std::chrono::seconds* value) {
  uint32_t seconds = 0;
  if (!read_number<uint32_t>(text, 0, std::numeric_limits<uint32_t>::max(), &seconds)) return false;
  *value = std::chrono::seconds(seconds);
  return true;
}

/// Reads one of two words.
template <typename Value>
bool read_choice(Text text, const char* first, Value if_first, const char* second, Value if_second,
                 Value* value) {
  if (text != first && text != second) return false;
  *value = text == first ? if_first : if_second;
  return true;
}

bool read_days(Text text, std::chrono::hours* value) {
  uint16_t days = 0;
  if (!read_number<uint16_t>(text, 0, std::numeric_limits<uint16_t>::max(), &days)) return false;
  *value = std::chrono::hours(24) * days;
  return true;
}

bool read_domain(Text text, int* value) {
  return read_number<int>(text, 0, static_cast<int>(wire::kMaxDomain), value);
}

template <typename Number>
std::string write_number(Number value) {
  return fmt::format("{}", value);
}

bool take(Text text, std::string* value) {
  *value = text;
  return true;
}

using Options = ServerOptions;

const ServerOptionRow kRows[] = {
    {"domain", "N", "DDS domain, 0 to 230 [0]", "expected a number from 0 to 230",
     [](Text text, Options* o) { return read_domain(text, &o->domain); },
     [](const Options& o) { return write_number(o.domain); }},
    {"listen", "IFACE|ADDR",
     "network interface or address of this machine [that of the profile; with wifi, of the default route]",
     kAnyWord, [](Text text, Options* o) { return take(text, &o->listen); },
     [](const Options& o) { return o.listen; }},
    {"profile", "loopback|wifi|FILE", "network profile [loopback]", kAnyWord,
     [](Text text, Options* o) { return take(text, &o->profile); },
     [](const Options& o) { return o.profile; }},
    {"seed", "N", "makes all ids reproducible; 0: random [0]", kFromZero,
     [](Text text, Options* o) {
       return read_number<uint64_t>(text, 0, std::numeric_limits<uint64_t>::max(), &o->seed);
     },
     [](const Options& o) { return write_number(o.seed); }},
    {"adjuster", "own|ceres", "solver of bundle adjustment; ceres is the slow, independent check [own]",
     "expected own or ceres",
     [](Text text, Options* o) {
       return read_choice(text, "own", Adjuster::kOwn, "ceres", Adjuster::kCeres, &o->mapping.adjuster);
     },
     [](const Options& o) -> std::string { return o.mapping.adjuster == Adjuster::kOwn ? "own" : "ceres"; }},
    {"relocalizer", "improved|paper",
     "how a lost camera is found: paper is the method of 2008, for comparison, which takes the image most "
     "alike for the place, wherever that is [improved]",
     "expected improved or paper",
     [](Text text, Options* o) {
       return read_choice(text, "improved", RelocMethod::kImproved, "paper", RelocMethod::kPaper,
                          &o->relocalization.method);
     },
     [](const Options& o) -> std::string {
       return o.relocalization.method == RelocMethod::kImproved ? "improved" : "paper";
     }},
    {"max-maps", "N", "maps at most [1000]", kFromOne,
     [](Text text, Options* o) { return read_count(text, &o->max_maps); },
     [](const Options& o) { return write_number(o.max_maps); }},
    {"max-maps-per-client", "N",
     "maps that one client may have made at most; deleted ones do not count [200]", kFromOne,
     [](Text text, Options* o) { return read_count(text, &o->max_maps_per_client); },
     [](const Options& o) { return write_number(o.max_maps_per_client); }},
    {"max-memory", "MB", "memory of all maps at most [half of the machine's]",
     "expected a number of megabytes from 1 on",
     [](Text text, Options* o) { return read_count(text, &o->max_memory_mb, kMostMegabytes); },
     [](const Options& o) { return write_number(o.max_memory_mb); }, /*depends=*/true},
    {"max-keyframes", "N", "keyframes of a map at most, up to 32768 [2000]",
     "expected a number from 1 to 32768",
     [](Text text, Options* o) { return read_count(text, &o->max_keyframes, kMaxKeyframes); },
     [](const Options& o) { return write_number(o.max_keyframes); }},
    {"max-labels", "N", "labels of a map at most, up to 1000 [1000]", "expected a number from 1 to 1000",
     [](Text text, Options* o) { return read_count(text, &o->max_labels, kMaxLabels); },
     [](const Options& o) { return write_number(o.max_labels); }},
    {"keyframe-rate", "N",
     "keyframes a second that one client may offer in the long run, and 300 at once; 0: no limit [5]",
     kFromZero, [](Text text, Options* o) { return read_rate(text, &o->rates.keyframes); },
     [](const Options& o) { return write_number(o.rates.keyframes); }},
    {"query-rate", "N",
     "relocalization queries a second that one client may make in the long run, and 100 at once; 0: no limit "
     "[20]",
     kFromZero, [](Text text, Options* o) { return read_rate(text, &o->rates.queries); },
     [](const Options& o) { return write_number(o.rates.queries); }, /*depends=*/false, "question-rate"},
    {"store", "DIR", "keeps maps across restarts, in this folder [in memory only]", kAnyWord,
     [](Text text, Options* o) { return take(text, &o->store); }, [](const Options& o) { return o.store; }},
    {"idle-after", "SECONDS",
     "with --store, images of a map that nobody has worked on for so long are evicted from memory until "
     "somebody does; 0: never [60]",
     kSecondsFromZero, [](Text text, Options* o) { return read_seconds(text, &o->idle_after); },
     [](const Options& o) { return write_number(o.idle_after.count()); }, /*depends=*/false, "rest-after"},
    {"drop-after", "SECONDS",
     "a map that its maker loses within a second, and in which nobody is found again, is deleted when its "
     "maker has been elsewhere for so long; 0: never [10]",
     kSecondsFromZero, [](Text text, Options* o) { return read_seconds(text, &o->drop_after); },
     [](const Options& o) { return write_number(o.drop_after.count()); }},
    {"keep-deleted", "DAYS",
     "with --store, maps that were deleted so long ago are removed for good; 0: `cairnctl maps purge` does "
     "that [0]",
     "expected a number of days from 0 on",
     [](Text text, Options* o) { return read_days(text, &o->keep_deleted); },
     [](const Options& o) { return write_number(o.keep_deleted.count() / 24); }},
    {"lockstep", "allow|refuse",
     "whether trackers may run with --pace lockstep, in which the server finishes all work of a map before "
     "it answers: for repeatable runs, at the cost of all others [allow with profile loopback, else refuse]",
     "expected allow or refuse",
     [](Text text, Options* o) { return read_choice(text, "allow", true, "refuse", false, &o->lockstep); },
     [](const Options& o) -> std::string { return o.lockstep ? "allow" : "refuse"; }, /*depends=*/true},
    {"wearer-rule", "first|only",
     "where one camera of a wearer is tracked, the wearer's others are looked for first, or there only "
     "[first]",
     "expected first or only",
     [](Text text, Options* o) {
       return read_choice(text, "first", WearerPolicy::kFirst, "only", WearerPolicy::kOnly,
                          &o->wearer_policy);
     },
     [](const Options& o) -> std::string {
       return o.wearer_policy == WearerPolicy::kFirst ? "first" : "only";
     }},
    {"wearers", "FILE", "who wears which cameras: YAML, `anna: [hand-1, shoulder-1]` [as cairn-track claims]",
     kAnyWord, [](Text text, Options* o) { return take(text, &o->wearers); },
     [](const Options& o) { return o.wearers; }},
    {"stats", "FILE", "writes there at the end what the map makers did and how long it took, as JSON",
     kAnyWord, [](Text text, Options* o) { return take(text, &o->stats); },
     [](const Options& o) { return o.stats; }},
    {"security", "DIR", wire::kSecurityHelp, kAnyWord,
     [](Text text, Options* o) { return take(text, &o->security); },
     [](const Options& o) { return o.security; }},
    {"http", "ADDR:PORT", "dashboard, health and metrics", kAnyWord, nullptr,
     [](const Options&) { return std::string(); }},
};

}  // namespace

std::span<const ServerOptionRow> server_option_rows() {
  return kRows;
}

}  // namespace cairn

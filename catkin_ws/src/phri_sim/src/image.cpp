#include "phri_sim/image.hpp"

#include <dlfcn.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>

namespace phri_sim
{
namespace
{
namespace fs = std::filesystem;

[[noreturn]] void refuse(const std::string& path, const std::string& cause)
{
  throw PictureError("picture " + path + ": " + cause);
}

/// The program decode_picture, installed in the folder lib/phri_sim beside this library.
std::string decoder()
{
  Dl_info here;
  if (!dladdr(reinterpret_cast<const void*>(&readPicture), &here))
    throw std::runtime_error("decode_picture: cannot tell where libphri_sim is");
  return (fs::canonical(here.dli_fname).parent_path() / "phri_sim" / "decode_picture").string();
}

/// The decoder at work on one file, and what it writes.
class Decoding
{
public:
  Decoding(const std::string& path, const Raster& raster)
  {
    const std::string program = decoder(), width = std::to_string(raster.width), height = std::to_string(raster.height);
    const char* const arguments[] = { program.c_str(), path.c_str(), width.c_str(), height.c_str(), nullptr };
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0)
      throw std::runtime_error(std::string("decode_picture: no pipe: ") + std::strerror(errno));
    output_ = fdopen(ends[0], "rb");
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, ends[1], 1);
    posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY, 0);
    // the signals that end it must reach it, whatever this thread blocks or ignores
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    const int failure =
        posix_spawn(&process_, program.c_str(), &actions, &attributes, const_cast<char* const*>(arguments), environ);
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
    close(ends[1]);
    if (failure != 0)
    {
      process_ = -1;
      std::fclose(output_);
      throw std::runtime_error(program + ": cannot be started: " + std::strerror(failure));
    }
  }
  ~Decoding() { finish(); }
  Decoding(const Decoding&) = delete;
  Decoding& operator=(const Decoding&) = delete;

  bool read(void* data, std::size_t bytes) { return std::fread(data, 1, bytes, output_) == bytes; }
  std::FILE* output() { return output_; }
  /// Signal that ended the process, or 0.
  int finish()
  {
    if (process_ < 0)
      return 0;
    std::fclose(output_);  // a process that still writes gets SIGPIPE
    int status = 0;
    while (waitpid(process_, &status, 0) < 0 && errno == EINTR)
    {
    }
    process_ = -1;
    return WIFSIGNALED(status) ? WTERMSIG(status) : 0;
  }

private:
  pid_t process_ = -1;
  std::FILE* output_ = nullptr;
};

void requireFile(const std::string& path)
{
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status))
    refuse(path, "no such file; expected a PNG, JPEG, PGM or SVG file");
  if (!fs::is_regular_file(status))
    refuse(path, std::string(fs::is_directory(status) ? "is a directory" : "is no ordinary file") +
                     "; expected a PNG, JPEG, PGM or SVG file");
  const std::uintmax_t size = fs::file_size(path, error);
  if (error)
    refuse(path, error.message());
  if (size == 0)
    refuse(path, "is empty (0 bytes); expected a PNG, JPEG, PGM or SVG file");
  if (size > std::uintmax_t(kLargestFile))
    refuse(path, std::to_string(size) + " bytes: expected at most " + std::to_string(kLargestFile) + " (64 MB)");
}

[[noreturn]] void refuseUndecoded(const std::string& path, Decoding& decoding, const std::string& said)
{
  const int signal = decoding.finish();
  if (signal == SIGPROF)
    refuse(path, "takes longer to decode than 1.5 s of processor time: expected a smaller or simpler picture");
  if (signal != 0)
    refuse(path, "needs more than 200 MB to decode, or makes the decoder crash (signal " + std::to_string(signal) +
                     "): expected a smaller or simpler picture");
  refuse(path, said.empty() ? "the decoder gave no picture" : said);
}

std::uint8_t excess(int channel, int a, int b)
{
  return static_cast<std::uint8_t>(std::max(0, channel - std::max(a, b)));
}
}  // namespace

Picture readPicture(const std::string& path, const Raster& raster)
{
  requireFile(path);
  Decoding decoding(path, raster);
  Picture picture;
  GrayImage& image = picture.image;
  char head[1024] = "";
  if (!std::fgets(head, sizeof head, decoding.output()) || std::strcmp(head, "P6\n") != 0)
  {
    std::string said = head;
    for (char more[1024]; std::fgets(more, sizeof more, decoding.output()) && said.size() < 4096;)
      said += more;
    std::replace(said.begin(), said.end(), '\n', ' ');
    said.erase(said.find_last_not_of(' ') + 1);
    const std::string mark = "error: ";
    refuseUndecoded(path, decoding, said.compare(0, mark.size(), mark) == 0 ? said.substr(mark.size()) : "");
  }
  if (!std::fgets(head, sizeof head, decoding.output()) ||
      std::sscanf(head, "%d %d", &image.width, &image.height) != 2 || !std::fgets(head, sizeof head, decoding.output()))
    refuseUndecoded(path, decoding, "");
  const std::size_t width = std::size_t(image.width), size = width * std::size_t(image.height);
  image.pixels.resize(size);
  // by how much green and red exceed the other channels; empty as long as the picture is grey
  std::vector<std::uint8_t> green, red, row(3 * width);
  for (std::size_t start = 0; start < size; start += width)
  {
    if (!decoding.read(row.data(), row.size()))
      refuseUndecoded(path, decoding, "");
    for (std::size_t i = 0; i < width; ++i)
    {
      const int r = row[3 * i], g = row[3 * i + 1], b = row[3 * i + 2];
      image.pixels[start + i] = static_cast<std::uint8_t>((299 * r + 587 * g + 114 * b + 500) / 1000);
      const std::uint8_t more_green = excess(g, r, b), more_red = excess(r, g, b);
      if (more_green >= kDotContrast && green.empty())
        green.resize(size);
      if (more_red >= kDotContrast && red.empty())
        red.resize(size);
      if (!green.empty())
        green[start + i] = more_green;
      if (!red.empty())
        red[start + i] = more_red;
    }
  }
  decoding.finish();
  picture.green = findDot(std::move(green), image.width, image.height, "green", "where the object starts");
  picture.red = findDot(std::move(red), image.width, image.height, "red", "where it shall go");
  return picture;
}

GrayImage readImage(const std::string& path)
{
  return readPicture(path).image;
}
}  // namespace phri_sim

// Runs rviz with a configuration and operates it by a script, for tests and for pictures of the documentation.
//
//   phri_rviz_driver CONFIG STEPS     steps separated by ; (see driver_steps.hpp)
//   phri_rviz_driver CONFIG @FILE     one step per line; # begins a comment
//   phri_rviz_driver CONFIG -         one step per line from the standard input, until its end or `quit`; goes on after
//                                     a step that failed
//
// A step with spaces in an argument takes "double quotes". Prints `driver: ok [VALUE]` or `driver: error: step N
// 'TEXT': REASON` for each. Needs a display and a ROS master. Exit codes: 0 all steps done, 64 usage, 66 no such file,
// 70 a step failed.

#include <rviz/visualization_frame.h>
#include <rviz/visualizer_app.h>

#include <QApplication>
#include <QFile>
#include <QProcess>
#include <QtTest/QTest>
#include <iostream>
#include <mutex>
#include <optional>
#include <queue>
#include <thread>

#include "driver_steps.hpp"

namespace
{
constexpr int kUsage = 64, kNoInput = 66, kStepFailed = 70;

/// Lines of the standard input, read by a thread that ends with the program: a read cannot be interrupted.
class Lines
{
public:
  Lines()
  {
    std::thread([shared = shared_] {
      std::string line;
      while (std::getline(std::cin, line))
      {
        const std::lock_guard<std::mutex> lock(shared->mutex);
        shared->lines.push(QString::fromStdString(line));
      }
      const std::lock_guard<std::mutex> lock(shared->mutex);
      shared->lines.push("quit");
    }).detach();
  }

  QString next()
  {
    for (;;)
    {
      {
        const std::lock_guard<std::mutex> lock(shared_->mutex);
        if (!shared_->lines.empty())
        {
          const QString line = shared_->lines.front();
          shared_->lines.pop();
          return line;
        }
      }
      QTest::qWait(5);  // the window lives on
    }
  }

private:
  struct Shared
  {
    std::mutex mutex;
    std::queue<QString> lines;
  };
  std::shared_ptr<Shared> shared_ = std::make_shared<Shared>();
};

class Script
{
public:
  explicit Script(QWidget& window) : steps_(window) {}

  /// False: it failed.
  bool run(const QString& text)
  {
    ++number_;
    try
    {
      const QString value = steps_.run(QProcess::splitCommand(text));
      std::cout << "driver: ok" << (value.isEmpty() ? "" : " " + value.toStdString()) << std::endl;
      return true;
    }
    catch (const phri_rviz::StepError& error)
    {
      std::cout << "driver: error: step " << number_ << " '" << text.toStdString() << "': " << error.what()
                << std::endl;
      return false;
    }
  }

private:
  phri_rviz::DriverSteps steps_;
  int number_ = 0;
};

bool isStep(const QString& line)
{
  return !line.trimmed().isEmpty() && !line.trimmed().startsWith('#');
}

int runAll(QWidget& window, const std::optional<QStringList>& steps)
{
  Script script(window);
  bool good = true;
  if (steps)
  {
    for (const QString& line : *steps)
      if (line.trimmed() == "quit" || !good)
        break;
      else if (isStep(line))
        good = script.run(line.trimmed());
    return good ? 0 : kStepFailed;
  }
  Lines lines;
  for (QString line = lines.next(); line.trimmed() != "quit"; line = lines.next())
    if (isStep(line))
      good = script.run(line.trimmed()) && good;
  return good ? 0 : kStepFailed;
}
}  // namespace

int main(int argc, char** argv)
{
  if (argc < 3)
  {
    std::cerr << "usage: phri_rviz_driver CONFIG STEPS|@FILE|-" << std::endl;
    return kUsage;
  }
  const QString config = argv[1], source = argv[2];
  std::optional<QStringList> steps;
  if (source.startsWith('@'))
  {
    QFile file(source.mid(1));
    if (!file.open(QIODevice::ReadOnly))
    {
      std::cerr << "phri_rviz_driver: cannot read " << file.fileName().toStdString() << std::endl;
      return kNoInput;
    }
    steps = QString::fromUtf8(file.readAll()).split('\n');
  }
  else if (source != "-")
    steps = source.split(';');
  if (!QFile::exists(config))
  {
    std::cerr << "phri_rviz_driver: there is no " << config.toStdString() << std::endl;
    return kNoInput;
  }

  QApplication application(argc, argv);
  std::vector<char*> arguments{ argv[0], const_cast<char*>("-d"), argv[1] };
  arguments.insert(arguments.end(), argv + 3, argv + argc);
  rviz::VisualizerApp rviz;
  rviz.setApp(&application);
  if (!rviz.init(int(arguments.size()), arguments.data()))
    return kStepFailed;
  rviz::VisualizationFrame* window = nullptr;
  for (QWidget* widget : QApplication::topLevelWidgets())
    if (auto* frame = qobject_cast<rviz::VisualizationFrame*>(widget))
      window = frame;
  int status = kStepFailed;
  QTimer::singleShot(0, [&] {
    status = window && QTest::qWaitForWindowExposed(window) ? runAll(*window, steps) : kStepFailed;
    QApplication::quit();
  });
  QApplication::exec();
  return status;
}

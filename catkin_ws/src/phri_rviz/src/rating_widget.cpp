#include "rating_widget.hpp"

#include <QButtonGroup>
#include <QHBoxLayout>
#include <QLabel>
#include <QToolButton>
#include <QVBoxLayout>

namespace phri_rviz
{
namespace
{
constexpr int kWorst = 1, kBest = 6;
}

RatingWidget::RatingWidget(QWidget* parent) : QWidget(parent), label_(new QLabel), buttons_(new QButtonGroup(this))
{
  label_->setObjectName("ratingLabel");
  label_->setTextFormat(Qt::PlainText);
  label_->setWordWrap(true);
  auto* row = new QHBoxLayout;
  row->setSpacing(4);
  row->addWidget(new QLabel("hindered"));
  for (int rating = kWorst; rating <= kBest; ++rating)
  {
    auto* button = new QToolButton;
    button->setObjectName(QString("ratingButton%1").arg(rating));
    button->setText(QString::number(rating));
    button->setCheckable(true);
    button->setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Fixed);
    button->setMinimumHeight(28);
    buttons_->addButton(button, rating);
    row->addWidget(button);
  }
  row->addWidget(new QLabel("helped"));
  buttons_->setExclusive(false);  // a button is marked when its rating has been stored, not when it is clicked

  auto* layout = new QVBoxLayout(this);
  layout->setContentsMargins(0, 0, 0, 0);
  layout->setSpacing(4);
  layout->addWidget(label_);
  layout->addLayout(row);
  connect(buttons_, &QButtonGroup::idClicked, this, [this](int rating) {
    mark(stored_);
    label_->setStyleSheet("");
    label_->setText(QString("%1: sending %2 ...").arg(title_).arg(rating));
    Q_EMIT rate(rating);
  });
  clear();
}

void RatingWidget::mark(int rating)
{
  for (QAbstractButton* button : buttons_->buttons())
    button->setChecked(buttons_->id(button) == rating);
}

void RatingWidget::clear()
{
  label_->setStyleSheet("");
  label_->setText("Rating: after a finished trial");
  stored_ = 0;
  mark(stored_);
  for (QAbstractButton* button : buttons_->buttons())
    button->setEnabled(false);
}

void RatingWidget::setTrial(const phri_msgs::Trial& trial)
{
  clear();
  title_ = QString("Trial %1, %2").arg(trial.trial).arg(QString::fromStdString(trial.controller));
  if (trial.phase != phri_msgs::Trial::FINISHED)
  {
    label_->setText(title_ + (trial.phase == phri_msgs::Trial::STARTED ? ": can be rated when it has finished"
                                                                       : ": ended early, not rated"));
    return;
  }
  label_->setText(title_ + ": how helpful was the robot?");
  for (QAbstractButton* button : buttons_->buttons())
    button->setEnabled(true);
}

void RatingWidget::setRated(int rating, bool success, const QString& text)
{
  if (success)
    stored_ = rating;
  mark(stored_);
  label_->setStyleSheet(success ? "color: #1b6e34;" : "color: #b71c1c;");
  label_->setText(success ? QString("stored: %1 (%2)").arg(rating).arg(text) : "not stored: " + text);
}
}  // namespace phri_rviz

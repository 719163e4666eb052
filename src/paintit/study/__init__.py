"""A user study of realism (paper, supp. A.4): questions, a page that asks them, answers that are not lost, a report."""

"""What is asked of a model: runs, studies, pictures, known answers, and knobs to vary."""

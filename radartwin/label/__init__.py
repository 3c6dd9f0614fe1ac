"""Material labels of surfaces: sources of labels, questions to vision-language models, answers and their scores."""
